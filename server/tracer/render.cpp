#include "server/tracer/render.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>

#include "common/error.h"
#include "server/tracer/plan.h"
#include "server/tracer/reference/path.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/threads.h"
#include "server/tracer/wavefront/wavefront.h"

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

void check(const RenderSettings& settings, size_t pixels) {
  validate(settings.material);
  if (settings.estimates < 1 || settings.estimates > 16 ||
      settings.sample_count < settings.estimates) {
    throw invalid_input(
        fmt::format("estimates is {}; it must be in [1, 16] and at most the number of samples, {}",
                    settings.estimates, settings.sample_count));
  }
  if (settings.albedos.size() > kMaxAlbedos) {
    throw invalid_input(
        fmt::format("{} albedos; there may be {} at most", settings.albedos.size(), kMaxAlbedos));
  }
  for (const double albedo : settings.albedos) {
    if (!(albedo >= 0 && albedo <= settings.material.albedo)) {
      throw invalid_input(
          fmt::format("albedos: {}; each must be in [0, {}], the albedo of the material", albedo,
                      settings.material.albedo));
    }
  }
  if (settings.pilot_spp > 64) {
    throw invalid_input(fmt::format("pilot_spp is {}; it must be at most 64", settings.pilot_spp));
  }
  const bool important = std::all_of(settings.importance.begin(), settings.importance.end(),
                                     [](float i) { return i >= 0 && std::isfinite(i); });
  if ((!settings.importance.empty() && settings.importance.size() != pixels) || !important) {
    throw invalid_input(
        fmt::format("importance has {} values; it must have none, or one for each of the {} "
                    "pixels, finite and not negative",
                    settings.importance.size(), pixels));
  }
  if (settings.tracer == Tracer::kReference &&
      (!settings.albedos.empty() || settings.pilot_spp > 0)) {
    throw invalid_input("the reference tracer knows neither several albedos nor a pilot");
  }
}

FilmSums empty_sums(const Scene::Compiled& scene, const RenderSettings& settings,
                    const Plan& plan) {
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
  const Bounds& box = scene.boundary.bounds;
  const double size = static_cast<double>(length(box.max - box.min));
  sums.derivative_quanta = {
      sums.quantum * power_of_two_near(std::min(1 / settings.material.sigma_t, size)), sums.quantum,
      sums.quantum};
  const auto pixels = static_cast<size_t>(sums.width) * static_cast<size_t>(sums.height);
  sums.squares.resize(pixels);
  sums.hits.resize(pixels);
  sums.estimates.resize(settings.estimates);
  for (uint32_t k = 0; k < settings.estimates; ++k) {
    auto& estimate = sums.estimates[k];
    estimate.counts.resize(pixels);
    for (const PlannedPixel& p : plan.pixels) {
      estimate.counts[p.pixel] = static_cast<uint32_t>(
          samples_of_estimate(p.first_sample, p.sample_count, k, settings.estimates));
    }
    estimate.at_albedos.assign(settings.albedos.size(), std::vector<int64_t>(pixels));
    estimate.radiance.resize(pixels);
    if (settings.derivatives) {
      for (auto& derivative : estimate.derivatives) {
        derivative.resize(pixels);
      }
    }
  }
  return sums;
}

// Hands out the samples of a plan to threads, in its order, and takes what becomes of them.
class Distribution {
 public:
  Distribution(const Plan& plan, const RenderSettings& settings, FilmSums& sums)
      : plan_(plan),
        settings_(settings),
        sums_(sums),
        per_radiance_(1 / sums.quantum),
        per_square_(1 / sums.squares_quantum) {
    for (size_t i = 0; i < kCoordinates; ++i) {
      per_derivative_[i] = 1 / sums.derivative_quanta[i];
    }
  }

  // Sums over some samples of an estimate of a pixel.
  struct PixelSums {
    static constexpr uint32_t kNone = ~0U;
    uint32_t pixel = kNone, estimate = 0;
    int64_t hits = 0, radiance = 0, squares = 0;
    std::array<int64_t, kCoordinates> derivatives{};
    std::array<int64_t, kMaxAlbedos> at_albedos{};
  };

  // One thread's part. Paths of a pixel come one soon after the other, so their sums are collected
  // here before they go to the film, where other threads may be adding to the same pixels.
  class Desk final : public PathDesk {
   public:
    explicit Desk(Distribution& all) : all_(all) {}
    size_t take(std::span<PathOrder> orders) override { return all_.take(orders); }
    void deliver(const PathOrder& order, const PathEstimate& path) override {
      ++counters.paths;
      counters.steps += path.steps;
      const uint32_t estimates = all_.settings_.estimates, estimate = order.sample % estimates;
      PixelSums& sums = collected_[(order.pixel * estimates + estimate) % kCollected];
      if (sums.pixel != order.pixel || sums.estimate != estimate) {
        all_.add(sums);
        sums = {.pixel = order.pixel, .estimate = estimate};
      }
      sums.hits += path.hit ? 1 : 0;
      if (path.leaked) {
        ++counters.leaks;
      } else if (!all_.collect(path, sums)) {
        ++counters.invalid_samples;
      }
    }
    // To be called when all is delivered.
    void close() {
      for (PixelSums& sums : collected_) {
        all_.add(sums);
        sums = {};
      }
    }
    Counters counters;

   private:
    static constexpr size_t kCollected = 64;
    Distribution& all_;
    std::array<PixelSums, kCollected> collected_{};
  };

 private:
  size_t take(std::span<PathOrder> orders) {
    const uint64_t first = next_.fetch_add(orders.size(), std::memory_order_relaxed);
    if (first >= plan_.paths) {
      return 0;
    }
    const auto count = static_cast<size_t>(std::min<uint64_t>(orders.size(), plan_.paths - first));
    const auto begins_after = [](uint64_t path, const PlannedPixel& p) {
      return path < p.first_path;
    };
    auto at = std::upper_bound(plan_.pixels.begin(), plan_.pixels.end(), first, begins_after) - 1;
    for (size_t i = 0; i < count; ++i) {
      while (first + i >= at->first_path + at->sample_count) {
        ++at;
      }
      orders[i] = {at->pixel, at->first_sample + static_cast<uint32_t>(first + i - at->first_path),
                   at->baseline};
    }
    return count;
  }

  // Adds a path to sums, unless it is NaN, infinite or beyond their range: the one door for these.
  bool collect(const PathEstimate& path, PixelSums& sums) const {
    const double radiance = path.radiance * per_radiance_;
    bool representable = std::abs(radiance) < kMaxQuanta;  // false for NaN
    for (size_t i = 0; i < kCoordinates && settings_.derivatives; ++i) {
      representable =
          representable && std::abs(path.derivatives[i] * per_derivative_[i]) < kMaxQuanta;
    }
    for (size_t a = 0; a < settings_.albedos.size(); ++a) {
      representable = representable && std::abs(path.at_albedos[a] * per_radiance_) < kMaxQuanta;
    }
    if (!representable) {
      return false;
    }
    sums.radiance += std::llrint(radiance);
    sums.squares += std::llrint(std::min(path.radiance * path.radiance * per_square_, kMaxQuanta));
    for (size_t i = 0; i < kCoordinates && settings_.derivatives; ++i) {
      sums.derivatives[i] += std::llrint(path.derivatives[i] * per_derivative_[i]);
    }
    for (size_t a = 0; a < settings_.albedos.size(); ++a) {
      sums.at_albedos[a] += std::llrint(path.at_albedos[a] * per_radiance_);
    }
    return true;
  }

  void add(const PixelSums& part) {
    if (part.pixel == PixelSums::kNone) {
      return;
    }
    // Integers add up to the same in any order.
    const auto add_to = [](int64_t& sum, int64_t by) {
      std::atomic_ref(sum).fetch_add(by, std::memory_order_relaxed);
    };
    auto& estimate = sums_.estimates[part.estimate];
    add_to(estimate.radiance[part.pixel], part.radiance);
    for (size_t i = 0; i < kCoordinates && settings_.derivatives; ++i) {
      add_to(estimate.derivatives[i][part.pixel], part.derivatives[i]);
    }
    for (size_t a = 0; a < settings_.albedos.size(); ++a) {
      add_to(estimate.at_albedos[a][part.pixel], part.at_albedos[a]);
    }
    add_to(sums_.squares[part.pixel], part.squares);
    add_to(sums_.hits[part.pixel], part.hits);
  }

  const Plan& plan_;
  const RenderSettings& settings_;
  FilmSums& sums_;
  double per_radiance_, per_square_;
  std::array<double, kCoordinates> per_derivative_{};
  std::atomic<uint64_t> next_ = 0;
};

void add(Counters& into, const Counters& part) {
  into.paths += part.paths;
  into.steps += part.steps;
  into.invalid_samples += part.invalid_samples;
  into.leaks += part.leaks;
  into.cpu_seconds += part.cpu_seconds;
}

template <typename T>
void add(std::vector<T>& into, const std::vector<T>& part) {
  for (size_t i = 0; i < into.size(); ++i) {
    into[i] += part[i];
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

FilmSums render(const Scene::Compiled& scene, const RenderSettings& settings, const Plan& plan,
                const std::stop_token& stop) {
  FilmSums sums = empty_sums(scene, settings, plan);
  Distribution distribution(plan, settings, sums);
  // Not more than have something to do.
  constexpr uint64_t kPathsPerThread = 256;
  const uint64_t busy = 1 + plan.paths / kPathsPerThread;
  std::vector<Distribution::Desk> desks(std::min<uint64_t>(thread_count(settings.threads), busy),
                                        Distribution::Desk(distribution));
  on_threads(desks.size(), [&](size_t i) {
    Distribution::Desk& desk = desks[i];
    const double start = thread_cpu_seconds();
    if (settings.tracer == Tracer::kWavefront) {
      trace_wavefront(scene, settings, desk, stop);
    } else {
      trace_reference(scene, settings, desk, stop);
    }
    desk.close();
    desk.counters.cpu_seconds += thread_cpu_seconds() - start;
  });
  for (const Distribution::Desk& desk : desks) {
    add(sums.counters, desk.counters);
  }
  return sums;
}

}  // namespace

FilmSums render_grad(const Scene& scene, const RenderSettings& settings, std::stop_token stop) {
  check(settings, static_cast<size_t>(scene.width()) * static_cast<size_t>(scene.height()));
  const Scene::Compiled& compiled = scene.compiled();
  if (settings.pilot_spp == 0) {
    return render(compiled, settings, even_plan(compiled, settings), stop);
  }
  const RenderSettings pilot = pilot_settings(settings);
  const FilmSums coarse = render(compiled, pilot, even_plan(compiled, pilot), stop);
  FilmSums sums = render(compiled, settings, plan_from_pilot(compiled, settings, coarse), stop);
  add(sums.counters, coarse.counters);
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
    add(into.estimates[k].counts, part.estimates[k].counts);
    for (size_t i = 0; i < kCoordinates; ++i) {
      add(into.estimates[k].derivatives[i], part.estimates[k].derivatives[i]);
    }
    for (size_t a = 0; a < into.estimates[k].at_albedos.size(); ++a) {
      add(into.estimates[k].at_albedos[a], part.estimates[k].at_albedos[a]);
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
  for (const auto& estimate : sums.estimates) {
    auto& image = images.estimates.emplace_back();
    image.radiance = averages(estimate.radiance, sums.quantum, estimate.counts);
    for (size_t i = 0; i < kCoordinates; ++i) {
      image.derivatives[i] =
          averages(estimate.derivatives[i], sums.derivative_quanta[i], estimate.counts);
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
