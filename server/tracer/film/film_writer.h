// How paths get onto the film. Internal to the tracer.
#pragma once

#include <array>
#include <cstdint>

#include "common/vec.h"
#include "server/tracer/film/film.h"
#include "server/tracer/film/plan.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// What one path from the camera contributes to its pixel. Of the arrays, as many values count as
// were asked for.
struct PathEstimate {
  double radiance = 0;
  std::array<double, kMaxDerivatives> derivatives{};  // for RenderRequest::derivatives
  std::array<double, kMaxAlbedos> other_media{};      // radiance for its albedos or colours
  bool hit = false;                                   // the camera ray meets the object
  bool leaked = false;                                // to be dropped
  uint32_t steps = 0;                                 // free flights inside the medium
};

// An empty film for a render.
FilmSums empty_film(const Scene::Compiled& scene, const RenderRequest& request, const Plan& plan);

// One thread's way to the film. Paths of a pixel come one soon after the other, so their sums are
// collected here before they go to the film, where other threads may be adding to the same pixels.
class FilmWriter {
 public:
  explicit FilmWriter(FilmSums& film);
  void add(const PathSample& sample, const PathEstimate& path);
  // Light that reaches the pixel of a sample from a pixel of the panorama, per radiance there.
  void add_to_map(uint32_t pixel, uint32_t sample, size_t map_pixel, double per_radiance);
  // Adds what the three corners' normals of a triangle change of it.
  void add_to_normals(uint32_t pixel, uint32_t sample, uint32_t triangle,
                      const std::array<Vec3d, 3>& by_corner);
  // To be called when all is added.
  void close();

  Counters counters;

 private:
  // Sums over some samples of an estimate of a pixel.
  struct PixelSums {
    static constexpr uint32_t kNone = ~0U;
    uint32_t pixel = kNone, estimate = 0;
    Sum hits = 0, radiance = 0, squares = 0;
    std::array<Sum, kMaxDerivatives> derivatives{};
    std::array<Sum, kMaxAlbedos> other_media{}, other_squares{};
  };
  bool collect(const PathEstimate& path, PixelSums& sums);
  // Adds them to the film.
  void flush(const PixelSums& sums);
  void restart(PixelSums& sums, uint32_t pixel, uint32_t estimate) const;

  static constexpr size_t kCollected = 64;
  FilmSums* film_;
  uint32_t estimates_;
  bool is_gradient_;
  size_t derivatives_, other_media_, other_squares_;  // how many images of each
  // Sums of estimates, by derivative, that are collected here until close().
  std::vector<std::array<Sum, kMaxDerivatives>> gradients_;
  double per_radiance_, per_square_;
  std::array<double, kMaxDerivatives> per_derivative_{};
  std::array<PixelSums, kCollected> collected_{};
};

}  // namespace itn::tracer
