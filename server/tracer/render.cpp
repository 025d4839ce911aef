#include "server/tracer/render.h"

#include <fmt/format.h>
#include <tbb/blocked_range2d.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <time.h>

#include <cmath>
#include <numbers>

#include "common/error.h"
#include "server/tracer/compiled_scene.h"
#include "server/tracer/fork_join.h"
#include "server/tracer/path.h"

namespace itn::tracer {
namespace {

// Radiance is counted in 2^-20 of a power of two near the lights' mean radiance: far below what a
// sample is worth. A sample may be 2^22 times that mean, as when the camera looks into the smallest
// sun, and 2^20 of them do not overflow 63 bits.
constexpr int kQuantumBits = 20;
constexpr double kMaxQuanta = 0x1p42;

// Squares are counted in 2^-30 of the mean's square, so that dark pixels have a standard error too,
// and cut off at 2^42 quanta, a radiance of 64 times the mean.
constexpr int kSquaresQuantumBits = 30;

double power_of_two_near(double x) {
  return std::exp2(std::round(std::log2(x)));
}

double thread_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

void check(const RenderSettings& settings) {
  validate(settings.material);
  if (settings.estimates < 1 || settings.estimates > 16 ||
      settings.sample_count < settings.estimates) {
    throw invalid_input(
        fmt::format("estimates is {}; it must be in [1, 16] and at most the number of samples, {}",
                    settings.estimates, settings.sample_count));
  }
}

FilmSums empty_sums(const Scene::Compiled& scene, const RenderSettings& settings) {
  FilmSums sums;
  sums.width = scene.film.width;
  sums.height = scene.film.height;
  sums.first_sample = settings.first_sample;
  sums.sample_count = settings.sample_count;
  const double mean = power_of_two_near(scene.lights.power() / (4 * std::numbers::pi));
  sums.quantum = std::ldexp(mean, -kQuantumBits);
  sums.squares_quantum = std::ldexp(mean * mean, -kSquaresQuantumBits);
  // The derivative in sigma_t is of the order of radiance times a free path, or times the size of
  // the object where that is shorter.
  const Bounds& box = scene.geometry.object_bounds();
  const double size = static_cast<double>(length(box.max - box.min));
  sums.derivative_quanta = {
      sums.quantum * power_of_two_near(std::min(1 / settings.material.sigma_t, size)), sums.quantum,
      sums.quantum};
  const auto pixels = static_cast<size_t>(sums.width) * static_cast<size_t>(sums.height);
  sums.squares.resize(pixels);
  sums.hits.resize(pixels);
  sums.estimates.resize(settings.estimates);
  for (auto& estimate : sums.estimates) {
    estimate.radiance.resize(pixels);
    if (settings.derivatives) {
      for (auto& derivative : estimate.derivatives) {
        derivative.resize(pixels);
      }
    }
  }
  return sums;
}

// The one door for NaN, infinities and values beyond the range of the sums.
bool representable(const FilmSums& sums, const PathEstimate& path) {
  bool result = std::abs(path.radiance) < kMaxQuanta * sums.quantum;  // false for NaN
  for (size_t i = 0; i < kCoordinates; ++i) {
    result = result && std::abs(path.derivatives[i]) < kMaxQuanta * sums.derivative_quanta[i];
  }
  return result;
}

int64_t quanta(double value, double quantum) {
  return std::llrint(value / quantum);
}

void add(FilmSums& sums, size_t pixel, size_t estimate_index, const PathEstimate& path) {
  auto& estimate = sums.estimates[estimate_index];
  estimate.radiance[pixel] += quanta(path.radiance, sums.quantum);
  for (size_t i = 0; i < kCoordinates; ++i) {
    if (!estimate.derivatives[i].empty()) {
      estimate.derivatives[i][pixel] += quanta(path.derivatives[i], sums.derivative_quanta[i]);
    }
  }
  sums.squares[pixel] +=
      quanta(std::min(path.radiance * path.radiance, kMaxQuanta * sums.squares_quantum),
             sums.squares_quantum);
}

void render_pixel(const Scene::Compiled& scene, const RenderSettings& settings, int x, int y,
                  const std::stop_token& stop, FilmSums& sums, Counters& counters) {
  const auto pixel =
      static_cast<size_t>(y) * static_cast<size_t>(sums.width) + static_cast<size_t>(x);
  for (uint32_t i = 0; i < settings.sample_count; ++i) {
    const uint32_t sample = settings.first_sample + i;
    const SampleRandom random(settings.seed, static_cast<uint32_t>(pixel), sample);
    const PathEstimate path = trace_path(scene, settings, x, y, random, stop);
    ++counters.paths;
    counters.steps += path.steps;
    sums.hits[pixel] += path.hit ? 1 : 0;
    if (path.leaked) {
      ++counters.leaks;
    } else if (!representable(sums, path)) {
      ++counters.invalid_samples;
    } else {
      add(sums, pixel, sample % settings.estimates, path);
    }
  }
}

void add(Counters& into, const Counters& part) {
  into.paths += part.paths;
  into.steps += part.steps;
  into.invalid_samples += part.invalid_samples;
  into.leaks += part.leaks;
  into.cpu_seconds += part.cpu_seconds;
}

void add(std::vector<int64_t>& into, const std::vector<int64_t>& part) {
  for (size_t i = 0; i < into.size(); ++i) {
    into[i] += part[i];
  }
}

std::vector<float> scaled(const std::vector<int64_t>& sums, double factor) {
  std::vector<float> result(sums.size());
  for (size_t i = 0; i < sums.size(); ++i) {
    result[i] = static_cast<float>(static_cast<double>(sums[i]) * factor);
  }
  return result;
}

std::vector<float> standard_errors(const FilmSums& sums) {
  std::vector<float> result(sums.squares.size());
  const double n = sums.sample_count;
  if (n < 2) {
    return result;
  }
  for (size_t i = 0; i < result.size(); ++i) {
    double total = 0;
    for (const auto& estimate : sums.estimates) {
      total += static_cast<double>(estimate.radiance[i]) * sums.quantum;
    }
    const double mean = total / n;
    const double mean_square = static_cast<double>(sums.squares[i]) * sums.squares_quantum / n;
    result[i] = static_cast<float>(std::sqrt(std::max(0.0, mean_square - mean * mean) / (n - 1)));
  }
  return result;
}

}  // namespace

FilmSums render_grad(const Scene& scene, const RenderSettings& settings, std::stop_token stop) {
  check(settings);
  const Scene::Compiled& compiled = scene.compiled();
  FilmSums sums = empty_sums(compiled, settings);
  tbb::enumerable_thread_specific<Counters> counters;
  ForkJoin order;
  const auto render_tile = [&](const tbb::blocked_range2d<int>& tile) {
    order.begin_iteration();
    const double start = thread_cpu_seconds();
    Counters& mine = counters.local();
    for (int y = tile.rows().begin(); y < tile.rows().end(); ++y) {
      for (int x = tile.cols().begin(); x < tile.cols().end(); ++x) {
        if (stop.stop_requested()) {
          throw Error(ErrorKind::kCancelled, "the render was stopped");
        }
        render_pixel(compiled, settings, x, y, stop, sums, mine);
      }
    }
    mine.cpu_seconds += thread_cpu_seconds() - start;
    order.end_iteration();
  };
  constexpr size_t kTile = 4;  // pixels: small, so that small films keep all threads busy
  tbb::task_arena arena(settings.threads > 0 ? settings.threads : tbb::info::default_concurrency());
  order.before_loop();
  arena.execute([&] {
    tbb::parallel_for(tbb::blocked_range2d<int>(0, sums.height, kTile, 0, sums.width, kTile),
                      render_tile, tbb::simple_partitioner());
  });
  order.after_loop();
  for (const Counters& part : counters) {
    add(sums.counters, part);
  }
  return sums;
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
    add(into.estimates[k].radiance, part.estimates[k].radiance);
    for (size_t i = 0; i < kCoordinates; ++i) {
      add(into.estimates[k].derivatives[i], part.estimates[k].derivatives[i]);
    }
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
  const auto estimates = static_cast<uint32_t>(sums.estimates.size());
  for (uint32_t k = 0; k < estimates; ++k) {
    const auto n = static_cast<double>(
        samples_of_estimate(sums.first_sample, sums.sample_count, k, estimates));
    const auto& estimate = sums.estimates[k];
    auto& image = images.estimates.emplace_back();
    image.radiance = scaled(estimate.radiance, sums.quantum / n);
    for (size_t i = 0; i < kCoordinates; ++i) {
      image.derivatives[i] = scaled(estimate.derivatives[i], sums.derivative_quanta[i] / n);
    }
  }
  images.mask = scaled(sums.hits, 1.0 / sums.sample_count);
  images.standard_error = standard_errors(sums);
  return images;
}

}  // namespace itn::tracer
