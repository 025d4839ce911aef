#include "server/tracer/scene/object_pixels.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <numeric>

#include "common/error.h"
#include "common/threads.h"
#include "server/tracer/geometry/lines/follow.h"

namespace itn::tracer {
namespace {

constexpr int kMaskRays = ObjectPixels::kMaskRays, kRaysPerPixel = kMaskRays * kMaskRays;
// The ray of a pixel that is tried first: it meets the object in most pixels that do, and spares
// them the others.
constexpr int kFirstRay = 5;

// The pixels that the image of the object's box touches, as a rectangle of the film.
struct Rectangle {
  int left, top, right, bottom;  // the last two beyond

  Rectangle(const Camera::FilmBox& box, const FilmDescription& film)
      : left(clamped(std::floor(box.left), film.width)),
        top(clamped(std::floor(box.top), film.height)),
        right(clamped(std::floor(box.right) + 1, film.width)),
        bottom(clamped(std::floor(box.bottom) + 1, film.height)) {}

  static int clamped(double edge, int size) {
    return static_cast<int>(std::clamp(edge, 0.0, static_cast<double>(size)));
  }
};

// Follows rays of pixels, many at a time, and marks the pixels that see the object.
class MaskTracer {
 public:
  MaskTracer(const Scene::Compiled& scene, std::vector<uint8_t>& sees, const std::stop_token& stop)
      : scene_(scene), sees_(sees), stop_(stop), rays_(std::make_unique<Rays>()) {
    rays_->bounded = scene.lights.has_lamps();
  }

  void add(uint32_t pixel, int ray) {
    const auto width = static_cast<uint32_t>(scene_.film.width);
    const uint32_t column = pixel % width, row = pixel / width;
    const int ray_column = ray % kMaskRays, ray_row = ray / kMaskRays;
    const double x = column + (ray_column + 0.5) / kMaskRays;
    const double y = row + (ray_row + 0.5) / kMaskRays;
    if (!scene_.film_box.contains(x, y)) return;
    const CameraRay from = scene_.camera_ray(x, y);
    rays_->position.set(count_, from.origin);
    rays_->direction.set(count_, from.direction);
    rays_->interaction[count_] = 0;
    rays_->max_medium_length[count_] = 0;
    rays_->distance[count_] = scene_.lights.reach(from.origin, from.direction);
    pixel_of_ray_[count_++] = pixel;
    if (count_ == kSlots) follow_all();
  }

  void follow_all() {
    if (stop_.stop_requested()) throw Error(ErrorKind::kCancelled, "the render was stopped");
    follow(scene_.obstacles, *rays_, count_);
    for (size_t i = 0; i < count_; ++i) {
      if (rays_->outcome[i] & Rays::kEntered) sees_[pixel_of_ray_[i]] = 1;
    }
    count_ = 0;
  }

 private:
  const Scene::Compiled& scene_;
  std::vector<uint8_t>& sees_;
  const std::stop_token& stop_;
  std::unique_ptr<Rays> rays_;
  std::array<uint32_t, kSlots> pixel_of_ray_{};
  size_t count_ = 0;
};

}  // namespace

ObjectPixels::ObjectPixels(const Scene::Compiled& scene, int threads, const std::stop_token& stop) {
  const auto width = static_cast<uint32_t>(scene.film.width);
  const size_t count = static_cast<size_t>(width) * static_cast<size_t>(scene.film.height);
  if (scene.camera_inside) {
    pixels.resize(count);
    std::iota(pixels.begin(), pixels.end(), 0U);
    return;
  }
  const Rectangle box(scene.film_box, scene.film);
  std::vector<uint8_t> sees(count);
  constexpr int kRows = 4;  // that a thread takes at a time
  std::atomic<int> next = box.top;
  const auto look_at_rows = [&](size_t) {
    MaskTracer mask_tracer(scene, sees, stop);
    for (int top = next.fetch_add(kRows); top < box.bottom; top = next.fetch_add(kRows)) {
      const auto for_pixels = [&](const auto& visit) {
        for (int y = top; y < std::min(top + kRows, box.bottom); ++y) {
          for (int x = box.left; x < box.right; ++x) {
            visit(static_cast<uint32_t>(y) * width + static_cast<uint32_t>(x));
          }
        }
        mask_tracer.follow_all();
      };
      for_pixels([&](uint32_t pixel) { mask_tracer.add(pixel, kFirstRay); });
      for_pixels([&](uint32_t pixel) {
        for (int ray = 0; ray < kRaysPerPixel && !sees[pixel]; ++ray) {
          if (ray != kFirstRay) mask_tracer.add(pixel, ray);
        }
      });
    }
  };
  const int stripes = std::max(1, (box.bottom - box.top + kRows - 1) / kRows);
  on_threads(std::min(thread_count(threads), static_cast<size_t>(stripes)), look_at_rows);
  for (int y = box.top; y < box.bottom; ++y) {
    for (int x = box.left; x < box.right; ++x) {
      const uint32_t pixel = static_cast<uint32_t>(y) * width + static_cast<uint32_t>(x);
      if (sees[pixel]) pixels.push_back(pixel);
    }
  }
}

}  // namespace itn::tracer
