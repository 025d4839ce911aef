// The light of a studio.
#pragma once

#include "itn/v1/dataset.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// Soft boxes and lamps before dim walls (StudioChoice in dataset.proto says what the numbers mean),
// as a panorama. A pixel is a quarter of the shortest side of the smallest emitter at most, and a
// 64th of the half turn from top to bottom: an object without a gloss shows no finer detail.
v1::Pixels studio_panorama(const v1::Studio& studio);

}  // namespace itn
