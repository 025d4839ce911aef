// What cameras do to photographs, done to renders (CameraAugmentation in learning.proto).
#pragma once

#include <cstdint>

#include "common/learning/network_input.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// Throws Error (invalid input) that names the field.
void validate(const v1::CameraAugmentation& camera);

// What `itn train --camera` turns on: about what photographs show of it.
v1::CameraAugmentation default_camera_augmentation();

// Values of planes, to be combined with all of their pixels: planes -> planes x 1 x 1.
inline torch::Tensor per_plane(const torch::Tensor& values) {
  return values.view({-1, 1, 1});
}

// Whether it changes anything.
bool changes_images(const v1::CameraAugmentation& camera);

// Each image as cameras and masks drawn by hand might have made it. A function of its arguments
// alone; the result may share storage with the input, which stays as it is. An image in colour has
// one camera, whose contrast, shoulder and white are those of all colours. `images`: luminance,
// mask and noise; a weight map would be of the images of before, and is dropped.
//
// Masks have parts of pixels at their border. An object that covers the part a of a pixel, with
// luminance L there, before a background B, and a mask of m there give the luminance
//   (min(a, m) L + max(m - a, 0) B) / m,
// as if what the object covers lay inside of what the mask does, or the other way round. Blur by a
// Gaussian G turns a into G * a, and L into (G * (a L)) / (G * a). At its border L is that of
// pixels nearby which the object fills: renders have in pixels that it covers in part what is
// behind it, as bright as the light makes it, from which a network would learn what photographs
// before a curtain, or with a mask of finer pixels, do not have.
//
// Noise follows: relative noise n stays under vignetting, becomes c n under a contrast c and
// n / (1 + s y) under a shoulder s, which are their derivatives in ln-ln, and 0 where the luminance
// is clipped; under blur the variance of a L becomes (G^2 * (n a L)^2), for pixels whose noise has
// nothing in common; the background has none. (Blur leaves noise that neighbours share, which the
// white noise added to images afterwards does not: it is a fraction of that.)
ImageBatch with_camera_effects(const ImageBatch& images, const v1::CameraAugmentation& camera,
                               uint64_t seed);

}  // namespace itn
