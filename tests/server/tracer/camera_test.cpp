// Tests of where points of the scene are seen: the pinhole, its crops, and the distortion of a
// lens.
#include "server/tracer/scene/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/error.h"
#include "server/tracer/random/sampler.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

constexpr FilmDescription kFilm{.width = 120, .height = 80};

CameraDescription tilted() {
  return {.origin = {1, 2, 3}, .target = {1.5, 2.2, 1}, .up = {0.1, 1, 0}, .fov = 1};
}

// The place that OpenCV's projectPoints has, with a focal length f in pixels: (c_x + f x d, c_y + f
// y d), where d is the distortion. In a frame of its own, that of `tilted`.
std::array<double, 2> seen_at(const CameraDescription& camera, Vec3d point) {
  const Vec3d forward = itn::normalize(camera.target - camera.origin);
  const Vec3d right = itn::normalize(cross(forward, camera.up));
  const Vec3d down = cross(forward, right), v = point - camera.origin;
  const double x = dot(v, right) / dot(v, forward), y = dot(v, down) / dot(v, forward);
  const double r2 = x * x + y * y, d = 1 + camera.k_1 * r2 + camera.k_2 * r2 * r2;
  const double f = kFilm.width / (2 * std::tan(camera.fov / 2));
  return {camera.principal_x * kFilm.width + f * x * d,
          camera.principal_y * kFilm.height + f * y * d};
}

void expect_toward(const Camera& camera, double x, double y, Vec3d point) {
  const Vec3d toward = itn::normalize(camera.toward(x, y));
  const Vec3d expected = itn::normalize(point - camera.origin());
  EXPECT_LT(length(toward - expected), 1e-9) << x << " " << y;
}

TEST(CameraTest, SeesPointsWhereOpenCvProjectsThem) {
  CameraDescription description = tilted();
  description.principal_x = 0.45;
  description.principal_y = 0.6;
  for (const auto& [k_1, k_2] :
       {std::pair{0.0, 0.0}, std::pair{-0.25, 0.05}, std::pair{0.2, 0.0}, std::pair{0.1, -0.1}}) {
    description.k_1 = k_1;
    description.k_2 = k_2;
    const Camera camera(description, kFilm);
    int seen = 0;
    for (uint32_t i = 0; i < 200; ++i) {
      const Uniforms u = Sampler(4, 0, 0).uniforms(i, 0);
      const Vec3d point = description.target + Vec3d{u[0] - 0.5, u[1] - 0.5, u[2] - 0.5};
      const auto [x, y] = seen_at(description, point);
      if (x < 0 || x > kFilm.width || y < 0 || y > kFilm.height) continue;
      expect_toward(camera, x, y, point);
      ++seen;
    }
    EXPECT_GT(seen, 100);
  }
}

// A crop of a distorted image shows what the image shows there.
TEST(CameraTest, CropsShowAPartOfTheImage) {
  CameraDescription description = tilted();
  description.principal_x = 0.45;
  description.k_1 = -0.2;
  const Camera whole(description, kFilm);
  description.left = 0.25;
  description.right = 0.75;
  description.top = 0.1;
  description.bottom = 0.6;
  const Camera crop(description, {.width = 60, .height = 40});
  for (const double x : {0.0, 13.5, 60.0}) {
    for (const double y : {0.0, 21.25, 40.0}) {
      expect_toward(crop, x, y, whole.origin() + whole.toward(30 + x, 8 + y));
    }
  }
}

// Whatever is in a box is seen in the box of the film, which is hardly larger.
TEST(CameraTest, BoundsWhatIsSeenOfABox) {
  CameraDescription description = tilted();
  for (const auto& [k_1, k_2] :
       {std::pair{0.0, 0.0}, std::pair{-0.3, 0.08}, std::pair{0.3, -0.1}}) {
    description.k_1 = k_1;
    description.k_2 = k_2;
    const Camera camera(description, kFilm);
    for (const double shift : {0.0, 0.4}) {
      const Vec3d low = description.target + Vec3d{shift - 0.3, -0.2, -0.4};
      const Vec3d size{0.5, 0.4, 0.6};
      const Camera::FilmBox box = camera.film_box(low, low + size);
      double left = 1e9, right = -1e9;
      for (uint32_t i = 0; i < 2000; ++i) {
        const Uniforms u = Sampler(5, 0, 0).uniforms(i, 0);
        const auto side = [](float v) { return std::clamp(1.4 * double{v} - 0.2, 0.0, 1.0); };
        const auto [x, y] =
            seen_at(description,
                    low + Vec3d{size.x * side(u[0]), size.y * side(u[1]), size.z * side(u[2])});
        EXPECT_TRUE(box.contains(x, y)) << x << " " << y;
        left = std::min(left, x);
        right = std::max(right, x);
      }
      EXPECT_LT(box.right - box.left, 1.3 * (right - left));
    }
  }
}

TEST(CameraTest, RefusesWhatFoldsTheImage) {
  const auto refuses = [](const auto& change) {
    CameraDescription description = tilted();
    change(description);
    EXPECT_THROW(Camera(description, kFilm), Error);
  };
  refuses([](auto& c) { c.k_1 = -1; });
  refuses([](auto& c) { c.k_2 = -3; });
  refuses([](auto& c) { c.left = 1; });
  refuses([](auto& c) { c.bottom = -0.5; });
}

// Both tracers and the mask through a lens: a sphere in the middle is smaller by the distortion.
TEST(CameraTest, IsThatOfRenders) {
  const auto coverage = [](double k_1, Tracer tracer) {
    SceneDescription scene = studio("sphere", {ConstantLight{1}}, -1, 64);
    scene.camera.k_1 = k_1;
    scene.camera.fov *= 1.5;
    RenderRequest request{.material = {1, 0.5, 0}, .sample_count = 16};
    request.tracer = tracer;
    const RenderedImages images = means(render_grad(Scene(std::move(scene)), request));
    double sum = 0;
    for (const float m : images.mask) sum += double{m} / static_cast<double>(images.mask.size());
    return sum;
  };
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    // The silhouette is a circle: with its radius in focal lengths, its area scales by the square
    // of the factor there.
    const double plain = coverage(0, tracer), barrel = coverage(-0.5, tracer);
    SceneDescription scene = studio("sphere", {ConstantLight{1}}, -1, 64);
    const double width = 2 * std::tan(scene.camera.fov * 1.5 / 2);
    const double r = width * std::sqrt(plain / std::numbers::pi);
    EXPECT_NEAR(barrel / plain, std::pow(1 - 0.5 * r * r, 2), 0.01);
  }
}

}  // namespace
}  // namespace itn::testing
