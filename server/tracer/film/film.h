// What a render leaves behind: sums over samples, by pixel, and the images that they make.
#pragma once

#include <cstdint>
#include <vector>

#include "common/render_estimate.h"
#include "server/tracer/parameters/parameter.h"

namespace itn::tracer {

// What happened. `invalid_samples` and `leaks` are dropped (they count as 0 radiance).
struct Counters {
  uint64_t paths = 0;
  uint64_t steps = 0;  // free flights inside the medium
  uint64_t invalid_samples = 0;
  uint64_t leaks = 0;
  double cpu_seconds = 0;
};
void add(Counters& into, const Counters& part);

// An integer sum, which is the same in every order. Its 128 bits hold the faintest light that a
// sample may bring beside a lamp that the camera looks into.
__extension__ using Sum = __int128;

// Sums over samples in fixed point: value = integer * quantum. Integer sums have no order, so they
// do not depend on threads. Arrays are those of the tile that is rendered, top row first.
struct FilmSums {
  int width = 0, height = 0;  // of the tile
  int x = 0, y = 0;           // where it begins in the camera's film
  int film_width = 0;
  double quantum = 0;          // of radiance; a power of two
  double squares_quantum = 0;  // of squares
  // Quanta of derivatives, in the order of RenderRequest::derivatives.
  std::vector<double> derivative_quanta;
  // Factors of a gradient (RenderRequest::gradient_weights), which is a sum over paths of a factor
  // by estimate and pixel, times the unit, times the path's derivative: weight / samples, with a
  // largest factor of about 1.
  std::vector<std::vector<float>> gradient_factors;
  double gradient_unit = 0, map_quantum = 0;

  struct EstimateSums {
    std::vector<uint32_t> counts;  // of samples
    std::vector<Sum> radiance;
    std::vector<std::vector<Sum>> derivatives;  // in the order of RenderRequest::derivatives
    std::vector<Sum> gradient, map_gradient, normal_gradient;  // instead
    std::vector<std::vector<Sum>> other_media;  // radiance for RenderRequest::albedos or colours
  };
  std::vector<EstimateSums> estimates;
  std::vector<Sum> squares;                     // of radiance, over all estimates
  std::vector<std::vector<Sum>> other_squares;  // the same of each colour
  std::vector<Sum> hits;                        // camera rays that meet the object
  Counters counters;

  // The place in the arrays of a pixel that is numbered in the camera's film.
  size_t index_of(uint32_t pixel) const {
    const auto column = static_cast<int>(pixel % static_cast<uint32_t>(film_width));
    const auto row = static_cast<int>(pixel / static_cast<uint32_t>(film_width));
    return static_cast<size_t>(row - y) * static_cast<size_t>(width) +
           static_cast<size_t>(column - x);
  }
};

// Means over the samples, 0 where there are none; all arrays width * height, top row first.
struct RenderedImages {
  std::vector<RenderEstimate> estimates;
  std::vector<float> mask;  // fraction of camera rays that meet the object
  std::vector<std::vector<float>> colour_standard_errors;  // as the next one, of each colour
  std::vector<float> standard_error;  // of the mean radiance over all samples; 0 for less than two
};

RenderedImages means(const FilmSums& sums);

}  // namespace itn::tracer
