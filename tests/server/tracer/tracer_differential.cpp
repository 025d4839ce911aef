// Random scenes by both tracers, and by one in other words: images and derivatives have the same
// expectation. Prints what differs, with the number of its scene, and exits with 1 if anything
// does.
#include <fmt/format.h>
#include <time.h>

#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/error.h"
#include "tests/server/tracer/random_scenes.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

// Beyond this, in standard errors of 30 degrees of freedom, one in a million is by chance; it is
// looked at again with other random numbers, where beyond the second one is in ten thousand.
constexpr double kSuspicious = 6, kConfirmed = 4.2;
constexpr double kResolution = 0.02;
constexpr int kBatches = 16, kBatchesAgain = 64;

struct Tally {
  int scenes = 0, refused = 0, comparisons = 0, resolved = 0, differences = 0;
};

// Sums of renders: of several, for superposition.
using Renders = std::vector<RandomScene>;

std::vector<Estimated> estimates(const Renders& renders, Tracer tracer, uint32_t samples,
                                 int batches, uint64_t seed, double& leaks) {
  std::vector<std::vector<double>> values;
  for (const RandomScene& render : renders) {
    const Scene scene(render.description);
    RenderRequest request = render.request;
    request.tracer = tracer;
    request.sample_count = samples;
    for (int b = 0; b < batches; ++b) {
      request.seed = seed + static_cast<uint64_t>(b);
      const FilmSums sums = render_grad(scene, request);
      leaks += static_cast<double>(sums.counters.leaks + sums.counters.invalid_samples) /
               static_cast<double>(sums.counters.paths) /
               (batches * static_cast<double>(renders.size()));
      const auto layers = static_cast<int>(request.derivatives.size());
      values.resize(static_cast<size_t>(layers) + 1,
                    std::vector<double>(static_cast<size_t>(batches)));
      for (int layer = -1; layer < layers; ++layer) {
        values[static_cast<size_t>(layer + 1)][static_cast<size_t>(b)] += film_mean(sums, layer);
      }
    }
    seed += 1000003;
  }
  std::vector<Estimated> result;
  for (const std::vector<double>& of_layer : values) result.push_back(over_batches(of_layer));
  return result;
}

struct Comparison {
  std::string name;
  Renders a, b;
  Tracer tracer_a = Tracer::kWavefront, tracer_b = Tracer::kWavefront;
  double derivative_scale = 1;       // d / d sigma_t of a over that of b
  std::optional<double> truth = {};  // of the radiance, instead of b
};

std::vector<double> deviations(const Comparison& c, uint32_t samples, int batches, uint64_t seed,
                               bool& resolved, double& leaks, std::string& text) {
  const auto a = estimates(c.a, c.tracer_a, samples, batches, seed, leaks);
  std::vector<Estimated> b;
  if (c.truth) {
    b.push_back({*c.truth, 2e-3 * *c.truth});
  } else {
    b = estimates(c.b, c.tracer_b, samples, batches, seed + 500000003, leaks);
  }
  std::vector<double> result;
  text.clear();
  for (size_t layer = 0; layer < std::min(a.size(), b.size()); ++layer) {
    const double scale = layer == 1 ? c.derivative_scale : 1;
    const Estimated of_a{a[layer].mean * scale, a[layer].standard_error * scale};
    const double error = std::hypot(of_a.standard_error, b[layer].standard_error);
    const double off = of_a.mean - b[layer].mean;
    // What is the same but for rounding differs by nothing, however quiet both are.
    const double rounding = 1e-5 * std::abs(b[0].mean) + 1e-5 * std::abs(b[layer].mean);
    // The reference finds light behind a smooth boundary by chance: maybe none.
    const bool is_rare =
        b[0].mean == 0 && c.tracer_b == Tracer::kReference && is_delta(c.b[0].description.boundary);
    result.push_back(off == 0 || is_rare ? 0 : off / std::hypot(error, rounding));
    text += fmt::format("{}{:.6g} +- {:.2g} : {:.6g} +- {:.2g} (t {:+.1f})", layer == 0 ? "" : "; ",
                        of_a.mean, of_a.standard_error, b[layer].mean, b[layer].standard_error,
                        result.back());
    if (layer == 0) resolved = 4 * error < kResolution * std::abs(b[0].mean);
  }
  return result;
}

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

void compare(const Comparison& c, uint64_t number, const std::string& what, double budget,
             Tally& tally) {
  bool resolved = false;
  double leaks = 0;
  std::string text;
  const double begin = cpu_seconds();
  for (uint32_t samples = 16;; samples *= 4) {
    const double before = cpu_seconds();
    leaks = 0;
    const auto off = deviations(c, samples, kBatches, 1, resolved, leaks, text);
    for (size_t layer = 0; layer < off.size(); ++layer) {
      if (std::abs(off[layer]) < kSuspicious) continue;
      const auto again = deviations(c, samples, kBatchesAgain, 777777, resolved, leaks, text);
      if (again[layer] * (off[layer] > 0 ? 1 : -1) < kConfirmed) continue;
      ++tally.differences;
      fmt::print("DIFFERS scene {} {} layer {}: {}\n  {}\n", number, c.name, layer, text, what);
      std::fflush(stdout);
      resolved = true;
      break;
    }
    const double took = cpu_seconds() - before;
    if (resolved || cpu_seconds() - begin + 4 * took > budget) break;
  }
  if (leaks > 1e-4) {
    ++tally.differences;
    fmt::print("DROPS scene {} {}: {:.2g} of the paths\n  {}\n", number, c.name, leaks, what);
    std::fflush(stdout);
  }
  ++tally.comparisons;
  tally.resolved += resolved ? 1 : 0;
}

void look_at(uint64_t number, double budget, Tally& tally) {
  const RandomScene scene = random_scene(number);
  ++tally.scenes;
  try {
    const Scene compiled(scene.description);
    validate(scene.request, compiled);
  } catch (const Error& error) {
    ++tally.refused;
    fmt::print("refused scene {}: {}\n  {}\n", number, error.what(), scene.what);
    return;
  }
  const auto of = [&](const Comparison& c) { compare(c, number, scene.what, budget, tally); };
  of({"reference", {scene}, {scene}, Tracer::kWavefront, Tracer::kReference});
  // One of the relations in turn.
  RandomScene quiet = scene;
  quiet.request.derivatives.clear();
  switch (number % 6) {
    case 0: {
      constexpr double kFactor = 37.3;
      of({"scaled",
          {scaled(scene, kFactor)},
          {scene},
          Tracer::kWavefront,
          Tracer::kWavefront,
          1 / kFactor});
      break;
    }
    case 1: of({"turned", {turned(scene, 0.7)}, {scene}}); break;
    case 2: of({"cut triangles", {with_cut_triangles(scene)}, {scene}}); break;
    case 3: of({"split lights", {with_split_lights(scene)}, {scene}}); break;
    case 4: {
      Renders parts;
      for (size_t i = 0; i < scene.description.lights.size(); ++i)
        parts.push_back(lit_by(scene, i));
      of({"superposition", std::move(parts), {scene}});
      break;
    }
    default: {
      Comparison furnace{"furnace", {in_a_furnace(quiet)}, {}};
      furnace.truth = 1;
      of(furnace);
    }
  }
}

int run(int argc, char** argv) {
  CLI::App app("Compares the tracers over random scenes");
  uint64_t first = 1, scenes = 0;
  double seconds = 60, budget = 4;
  app.add_option("--first", first, "Number of the first scene");
  app.add_option("--scenes", scenes, "How many; 0: until the time is over");
  app.add_option("--seconds", seconds, "How long, without --scenes");
  app.add_option("--budget", budget, "CPU seconds of a comparison, about");
  CLI11_PARSE(app, argc, argv);
  const auto begin = std::chrono::steady_clock::now();
  Tally tally;
  for (uint64_t number = first;; ++number) {
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    if (scenes > 0 ? number == first + scenes : took.count() > seconds) break;
    look_at(number, budget, tally);
  }
  fmt::print(
      "scenes {} (refused {}), comparisons {}, of which {} would show {:g} %; differences {}\n",
      tally.scenes, tally.refused, tally.comparisons, tally.resolved, 100 * kResolution,
      tally.differences);
  return tally.differences > 0 ? 1 : 0;
}

}  // namespace
}  // namespace itn::testing

int main(int argc, char** argv) {
  return itn::testing::run(argc, argv);
}
