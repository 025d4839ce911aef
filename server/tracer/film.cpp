#include "server/tracer/film.h"

#include <algorithm>
#include <cmath>

#include "common/error.h"

namespace itn::tracer {
namespace {

template <typename T>
void add(std::vector<T>& into, const std::vector<T>& part) {
  for (size_t i = 0; i < into.size(); ++i) {
    into[i] += part[i];
  }
}

template <typename T>
void add(std::vector<std::vector<T>>& into, const std::vector<std::vector<T>>& part) {
  for (size_t i = 0; i < into.size(); ++i) {
    add(into[i], part[i]);
  }
}

// Sums by the numbers of their samples.
std::vector<float> averages(const std::vector<int64_t>& sums, double quantum,
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
    add(result, estimate.counts);
  }
  return result;
}

std::vector<float> standard_errors(const FilmSums& sums, const std::vector<uint32_t>& counts) {
  std::vector<float> result(sums.squares.size());
  for (size_t i = 0; i < result.size(); ++i) {
    if (counts[i] < 2) {
      continue;
    }
    double total = 0;
    for (const auto& estimate : sums.estimates) {
      total += static_cast<double>(estimate.radiance[i]) * sums.quantum;
    }
    const double n = counts[i], mean = total / n;
    const double mean_square = static_cast<double>(sums.squares[i]) * sums.squares_quantum / n;
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

void merge(FilmSums& into, const FilmSums& part) {
  if (into.width != part.width || into.height != part.height || into.quantum != part.quantum ||
      into.squares_quantum != part.squares_quantum ||
      into.derivative_quanta != part.derivative_quanta ||
      into.estimates.size() != part.estimates.size()) {
    throw Error(ErrorKind::kInternal, "sums of different renders cannot be merged");
  }
  into.first_sample = std::min(into.first_sample, part.first_sample);
  into.sample_count += part.sample_count;
  for (size_t k = 0; k < into.estimates.size(); ++k) {
    add(into.estimates[k].counts, part.estimates[k].counts);
    add(into.estimates[k].radiance, part.estimates[k].radiance);
    add(into.estimates[k].derivatives, part.estimates[k].derivatives);
    add(into.estimates[k].at_albedos, part.estimates[k].at_albedos);
  }
  add(into.squares, part.squares);
  add(into.hits, part.hits);
  add(into.counters, part.counters);
}

uint64_t samples_of_estimate(uint32_t first, uint32_t count, uint32_t k, uint32_t estimates) {
  // Of the samples 0 .. n-1, those that are k modulo K.
  const auto below = [&](uint64_t n) { return (n + estimates - 1 - k) / estimates; };
  return below(uint64_t{first} + count) - below(first);
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
    for (const std::vector<int64_t>& radiance : estimate.at_albedos) {
      image.at_albedos.push_back(averages(radiance, sums.quantum, estimate.counts));
    }
  }
  const std::vector<uint32_t> counts = all_counts(sums);
  images.mask = averages(sums.hits, 1, counts);
  images.standard_error = standard_errors(sums, counts);
  return images;
}

}  // namespace itn::tracer
