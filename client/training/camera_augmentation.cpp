#include "client/training/camera_augmentation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "common/error.h"
#include "common/random.h"

namespace itn {
namespace {

// Draws do not depend on each other: a choice that is switched off changes none of the rest.
enum CameraChoice : uint64_t {
  kTaken,
  kContrast,
  kShoulder,
  kVignetting,
  kBlur,
  kIsClipped,
  kClipped,
  kBorder,
  kMaskX,
  kMaskY,
  kBackground
};

// A smaller part of a pixel is none; so is a smaller luminance.
constexpr double kNothing = 1e-6, kNoLight = 1e-20;
constexpr double kBrightestBackground = 3;  // over the object's mean
// Pixels that are nothing but noise have infinitely much of it; so much is as good.
constexpr double kMaxNoise = 100;

// Numbers for the planes of some images of a batch, which do not depend on what others of it there
// are. Planes of an image have the same.
class Draws {
 public:
  Draws(uint64_t seed, const ImageBatch& images)
      : seed_(seed),
        count_(images.size()),
        channels_(images.channels),
        which_(torch::arange(images.planes())) {}

  // For these planes alone.
  Draws subset(const torch::Tensor& which) const {
    Draws some = *this;
    some.which_ = which;
    return some;
  }

  torch::Tensor uniform(CameraChoice choice, double low, double high) const {
    return filled(choice, [=](SplitMix& random) { return low + (high - low) * random.uniform(); });
  }

  // By Box and Muller.
  torch::Tensor normal(CameraChoice choice) const {
    return filled(choice, [](SplitMix& random) {
      const double radius = std::sqrt(-2 * std::log(1 - random.uniform()));
      return radius * std::cos(2 * std::numbers::pi * random.uniform());
    });
  }

 private:
  template <typename Draw>
  torch::Tensor filled(CameraChoice choice, const Draw& draw) const {
    SplitMix random(derive_seed(seed_, {choice}));
    torch::Tensor numbers = torch::empty({count_});
    auto values = numbers.accessor<float, 1>();
    for (int64_t i = 0; i < count_; ++i) values[i] = static_cast<float>(draw(random));
    return for_planes(numbers, channels_).index_select(0, which_);
  }

  uint64_t seed_;
  int64_t count_, channels_;
  torch::Tensor which_;
};

// --- The object's part of each pixel, and what comes from there ---

struct ObjectLayer {
  torch::Tensor coverage;  // a
  torch::Tensor radiance;  // a L
  torch::Tensor variance;  // of a L
};

// size x size: row y holds the Gaussian of one pixel about y.
torch::Tensor neighbourhood(int64_t size) {
  const torch::Tensor at = torch::arange(size, torch::kFloat32);
  return torch::exp((at.unsqueeze(1) - at).square() / -2);
}

// A render shows what is behind the object, too, where that covers a part of a pixel, which tells
// of the light: its own luminance is taken to be that of the pixels nearby that it fills.
torch::Tensor luminance_of_object(const ImageBatch& images) {
  constexpr double kFull = 0.99, kNearby = 0.01;
  const torch::Tensor full = (images.mask > kFull).to(torch::kFloat32);
  const torch::Tensor nearby = neighbourhood(full.size(-1));
  const auto sum = [&](const torch::Tensor& x) { return nearby.matmul(x).matmul(nearby); };
  const torch::Tensor weight = sum(full);
  return torch::where((full < kFull) & (weight > kNearby),
                      sum(images.luminance * full) / weight.clamp_min(kNearby), images.luminance);
}

ObjectLayer object_layer(const ImageBatch& images) {
  const torch::Tensor radiance = luminance_of_object(images) * images.mask;
  return {images.mask, radiance, (images.noise.clamp_max(kMaxNoise) * radiance).square()};
}

// images x size x size: each row the weights of a Gaussian about its number; they sum to 1.
torch::Tensor gaussians(const torch::Tensor& sigma, int64_t size) {
  const torch::Tensor at = torch::arange(size, torch::kFloat32);
  const torch::Tensor distance = at.unsqueeze(1) - at;
  constexpr double kSharp = 0.05;  // pixels: no neighbour gets anything
  const torch::Tensor weights =
      torch::exp(distance.square() / (-2 * per_plane(sigma.clamp_min(kSharp)).square()));
  return weights / weights.sum(-1, true);
}

// Rows and columns of each image by a matrix of its own.
torch::Tensor along_both(const torch::Tensor& matrices, const torch::Tensor& images) {
  return matrices.bmm(images).bmm(matrices.transpose(1, 2));
}

ObjectLayer blurred(const ObjectLayer& layer, const torch::Tensor& sigma) {
  const torch::Tensor g = gaussians(sigma, layer.coverage.size(-1));
  return {along_both(g, layer.coverage), along_both(g, layer.radiance),
          along_both(g.square(), layer.variance)};
}

// --- Masks ---

// The highest value among the neighbours along an axis, and here. (In two passes this is quicker
// than a max_pool2d.)
torch::Tensor widened_along(const torch::Tensor& mask, int64_t axis) {
  const int64_t last = mask.size(axis) - 1;
  torch::Tensor result = mask.clone();
  torch::Tensor after = result.narrow(axis, 1, last), before = result.narrow(axis, 0, last);
  torch::maximum_out(after, after, mask.narrow(axis, 0, last));
  torch::maximum_out(before, before, mask.narrow(axis, 1, last));
  return result;
}

torch::Tensor widened(const torch::Tensor& mask) {
  return widened_along(widened_along(mask, 1), 2);
}

// By `pixels` of each image, a part of the last step where it is a fraction; 0 or less: not at all.
torch::Tensor widened_by(const torch::Tensor& mask, const torch::Tensor& pixels, double most) {
  torch::Tensor result = mask, last = mask;
  for (int step = 0; step < static_cast<int>(std::ceil(most)); ++step) {
    const torch::Tensor next = widened(last);
    result = result + per_plane((pixels - step).clamp(0, 1)) * (next - last);
    last = next;
  }
  return result;
}

// images x size x size: moves what is at j to j + distance, shared out to the two pixels there.
torch::Tensor movements(const torch::Tensor& distance, int64_t size) {
  const torch::Tensor at = torch::arange(size, torch::kFloat32);
  return (1 - (at.unsqueeze(1) - at - per_plane(distance)).abs()).clamp_min(0);
}

torch::Tensor imprecise(const torch::Tensor& mask, double most, const Draws& draws) {
  const torch::Tensor outward = draws.uniform(kBorder, -most, most);
  const torch::Tensor wide = widened_by(mask, outward, most);
  const torch::Tensor border = 1 - widened_by(1 - wide, -outward, most);
  const int64_t size = mask.size(-1);
  return movements(draws.uniform(kMaskY, -most, most), size)
      .bmm(border)
      .bmm(movements(draws.uniform(kMaskX, -most, most), size).transpose(1, 2));
}

// What is in the mask: object and background.
ImageBatch masked(const ObjectLayer& object, const torch::Tensor& background,
                  const torch::Tensor& mask, int64_t channels) {
  const torch::Tensor of_object =
      torch::minimum(object.coverage, mask) / object.coverage.clamp_min(kNothing);
  const torch::Tensor of_background = (mask - object.coverage).clamp_min(0) * background;
  const torch::Tensor sum = of_object * object.radiance + of_background;
  const torch::Tensor inside = (mask > kNothing).to(torch::kFloat32);
  ImageBatch result;
  result.channels = channels;
  result.luminance = sum / mask.clamp_min(kNothing) * inside;
  result.mask = mask;
  result.noise = of_object * object.variance.sqrt() / sum.clamp_min(kNoLight) * inside;
  return result;
}

// --- Sensor and tone curve ---

// r^2 of each pixel.
torch::Tensor squared_radius(int64_t size) {
  const torch::Tensor at =
      (torch::arange(size, torch::kFloat32) + 0.5) * (2 / static_cast<double>(size)) - 1;
  return (at.unsqueeze(1).square() + at.square()) / 2;
}

void darken_corners(ImageBatch& images, const torch::Tensor& v) {
  const torch::Tensor r2 = squared_radius(images.luminance.size(-1));
  images.luminance = images.luminance / (1 + per_plane(v) * r2).square();
}

// The least of the brightest `part` of an object's pixels.
float white_point(const torch::Tensor& luminance, const torch::Tensor& mask, double part) {
  const torch::Tensor object = luminance.masked_select(mask > 0.5);
  const int64_t count = object.numel();
  const auto above = static_cast<int64_t>(part * static_cast<double>(count));
  if (above == 0) return HUGE_VALF;
  float* const values = object.data_ptr<float>();
  std::nth_element(values, values + above - 1, values + count, std::greater<>());
  return values[above - 1];
}

void clip(ImageBatch& images, const torch::Tensor& is_clipped, const torch::Tensor& part) {
  torch::Tensor white = torch::full({images.planes()}, HUGE_VAL);
  for (int64_t p = 0; p < images.planes(); p += images.channels) {
    if (is_clipped[p].item<float>() < 0.5F) {
      const auto of_image = [&](const torch::Tensor& planes) {
        return planes.slice(0, p, p + images.channels);
      };
      of_image(white).fill_(
          white_point(of_image(images.luminance), of_image(images.mask), part[p].item<double>()));
    }
  }
  images.noise = images.noise * (images.luminance < per_plane(white));
  images.luminance = torch::minimum(images.luminance, per_plane(white));
}

void change_contrast(ImageBatch& images, const torch::Tensor& c) {
  const torch::Tensor mean = mean_on_object(images).clamp_min(kNoLight);
  images.luminance = (images.luminance / mean).pow(per_plane(c)) * mean;
  images.noise = images.noise * per_plane(c);
}

void add_shoulder(ImageBatch& images, const torch::Tensor& s) {
  const torch::Tensor mean = mean_on_object(images).clamp_min(kNoLight);
  const torch::Tensor compressed = 1 + per_plane(s) * (images.luminance / mean);
  images.luminance = images.luminance * (1 + per_plane(s)) / compressed;
  images.noise = images.noise / compressed;
}

// Each of the images.
ImageBatch taken_by_camera(const ImageBatch& images, const v1::CameraAugmentation& camera,
                           const Draws& draws) {
  // Put the object before its background, out of focus, into a mask.
  ObjectLayer object = object_layer(images);
  if (camera.blur() > 0) object = blurred(object, draws.uniform(kBlur, 0, camera.blur()));
  const torch::Tensor mask =
      camera.mask() > 0 ? imprecise(images.mask, camera.mask(), draws) : images.mask;
  const torch::Tensor background =
      per_plane(draws.uniform(kBackground, 0, kBrightestBackground)) * mean_on_object(images);
  ImageBatch photographs = masked(object, background, mask, images.channels);
  // Expose and develop it.
  if (camera.vignetting() > 0) {
    darken_corners(photographs, draws.uniform(kVignetting, 0, camera.vignetting()));
  }
  if (camera.clipped() > 0) {
    clip(photographs, draws.uniform(kIsClipped, 0, 1),
         draws.uniform(kClipped, 0, camera.clipped()));
  }
  if (camera.contrast() > 0) {
    change_contrast(photographs, (camera.contrast() * draws.normal(kContrast)).exp());
  }
  if (camera.shoulder() > 0) {
    add_shoulder(photographs, draws.uniform(kShoulder, 0, camera.shoulder()));
  }
  return photographs;
}

void require_in(const char* name, double value, double high) {
  if (!(value >= 0 && value <= high)) {
    throw invalid_input(
        fmt::format("augmentation.camera.{} is {}; it must be in [0, {}]", name, value, high));
  }
}

}  // namespace

void validate(const v1::CameraAugmentation& camera) {
  require_in("share", camera.share(), 1);
  require_in("contrast", camera.contrast(), 1);
  require_in("shoulder", camera.shoulder(), 10);
  require_in("vignetting", camera.vignetting(), 2);
  require_in("blur", camera.blur(), 8);
  require_in("clipped", camera.clipped(), 0.5);
  require_in("mask", camera.mask(), 8);
}

v1::CameraAugmentation default_camera_augmentation() {
  v1::CameraAugmentation camera;
  camera.set_share(0.8);
  camera.set_contrast(0.2);
  camera.set_shoulder(1.5);
  camera.set_vignetting(0.5);
  camera.set_blur(1);
  camera.set_clipped(0.1);
  camera.set_mask(1);
  return camera;
}

bool changes_images(const v1::CameraAugmentation& camera) {
  return (!camera.has_share() || camera.share() > 0) &&
         (camera.contrast() > 0 || camera.shoulder() > 0 || camera.vignetting() > 0 ||
          camera.blur() > 0 || camera.clipped() > 0 || camera.mask() > 0);
}

ImageBatch with_camera_effects(const ImageBatch& images, const v1::CameraAugmentation& camera,
                               uint64_t seed) {
  if (!changes_images(camera)) return images;
  const torch::NoGradGuard no_gradient;
  const Draws all(seed, images);
  const double share = camera.has_share() ? camera.share() : 1;
  const torch::Tensor taken = (all.uniform(kTaken, 0, 1) < share).nonzero().squeeze(1);
  const auto replaced = [&](const torch::Tensor& plane, const torch::Tensor& photographs) {
    return plane.index_copy(0, taken, photographs);
  };
  const auto selected = [&](const torch::Tensor& plane) { return plane.index_select(0, taken); };
  const ImageBatch photographs = taken_by_camera({selected(images.luminance),
                                                  selected(images.mask),
                                                  {},
                                                  selected(images.noise),
                                                  images.channels},
                                                 camera, all.subset(taken));
  return {replaced(images.luminance, photographs.luminance),
          replaced(images.mask, photographs.mask),
          {},
          replaced(images.noise, photographs.noise),
          images.channels};
}

}  // namespace itn
