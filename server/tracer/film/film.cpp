#include "server/tracer/film/film.h"

#include <algorithm>
#include <cmath>

namespace itn::tracer {
namespace {

// Sums by the numbers of their samples.
std::vector<float> averages(const std::vector<Sum>& sums, double quantum,
                            const std::vector<uint32_t>& counts) {
  std::vector<float> result(sums.size());
  for (size_t i = 0; i < sums.size(); ++i) {
    result[i] = counts[i] == 0 ? 0.0F
                               : static_cast<float>(static_cast<double>(sums[i]) * quantum /
                                                    static_cast<double>(counts[i]));
  }
  return result;
}

std::vector<uint32_t> all_counts(const FilmSums& sums) {
  std::vector<uint32_t> result(sums.squares.size());
  for (const auto& estimate : sums.estimates) {
    for (size_t i = 0; i < result.size(); ++i) result[i] += estimate.counts[i];
  }
  return result;
}

// Standard errors of an image: `radiance_of(estimate)` are its sums, and `squares` those of
// squares.
std::vector<float> standard_errors(const FilmSums& sums, const std::vector<uint32_t>& counts,
                                   const std::vector<Sum>& squares, const auto& radiance_of) {
  std::vector<float> result(squares.size());
  for (size_t i = 0; i < result.size(); ++i) {
    if (counts[i] < 2) continue;
    double total = 0;
    for (const auto& estimate : sums.estimates) {
      total += static_cast<double>(radiance_of(estimate)[i]) * sums.quantum;
    }
    const double n = counts[i], mean = total / n;
    const double mean_square = static_cast<double>(squares[i]) * sums.squares_quantum / n;
    result[i] = static_cast<float>(std::sqrt(std::max(0.0, mean_square - mean * mean) / (n - 1)));
  }
  return result;
}

}  // namespace

void add(Counters& into, const Counters& part) {
  into.paths += part.paths;
  into.steps += part.steps;
  into.invalid_samples += part.invalid_samples;
  into.leaks += part.leaks;
  into.cpu_seconds += part.cpu_seconds;
}

RenderedImages means(const FilmSums& sums) {
  RenderedImages images;
  for (const auto& estimate : sums.estimates) {
    auto& image = images.estimates.emplace_back();
    image.radiance = averages(estimate.radiance, sums.quantum, estimate.counts);
    for (size_t i = 0; i < estimate.derivatives.size(); ++i) {
      image.derivatives.push_back(
          averages(estimate.derivatives[i], sums.derivative_quanta[i], estimate.counts));
    }
    for (size_t i = 0; i < estimate.gradient.size(); ++i) {
      image.gradient.push_back(static_cast<double>(estimate.gradient[i]) *
                               sums.derivative_quanta[i] * sums.gradient_unit);
    }
    for (const Sum sum : estimate.map_gradient) {
      image.map_gradient.push_back(
          static_cast<float>(static_cast<double>(sum) * sums.map_quantum * sums.gradient_unit));
    }
    for (const Sum sum : estimate.normal_gradient) {
      image.normal_gradient.push_back(
          static_cast<float>(static_cast<double>(sum) * sums.quantum * sums.gradient_unit));
    }
    for (const std::vector<Sum>& radiance : estimate.other_media) {
      image.other_media.push_back(averages(radiance, sums.quantum, estimate.counts));
    }
  }
  const std::vector<uint32_t> counts = all_counts(sums);
  images.mask = averages(sums.hits, 1, counts);
  images.standard_error = standard_errors(
      sums, counts, sums.squares, [](const auto& e) -> const auto& { return e.radiance; });
  for (size_t c = 0; c < sums.other_squares.size(); ++c) {
    images.colour_standard_errors.push_back(standard_errors(
        sums, counts,
        sums.other_squares[c], [c](const auto& e) -> const auto& { return e.other_media[c]; }));
  }
  return images;
}

}  // namespace itn::tracer
