// How well and how quickly itn refine finds the truth of synthetic images: refine_bench [--runs N]
// [--scene K] ... prints a line for each run and a summary of each scene: errors, coverage of the
// 95 % intervals, iterations, CPU-seconds and seconds.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "client/refine/refinement.h"
#include "client/render/reply_images.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/text_proto.h"
#include "common/random.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

struct Case {
  const char* name;
  const char* scene;  // without film
  Material truth;
  // Values of the scene that the images are of; the refinement starts from what `scene` says.
  std::vector<std::pair<std::string, double>> unknowns = {};
};

#define ITN_GROUND "surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } reflectance: 0.5 } "
#define ITN_CAMERA "camera { origin { y: 9.28 z: -32.8 } target { y: 0.5 } fov_degrees: 2.5 } "
const std::array<Case, 6> kCases = {{
    {"urchin, sun at 60",
     "object { mesh { builtin: \"urchin\" normalize: true } } " ITN_GROUND
     "lights { sun_sky { sun_angular_radius_degrees: 18.75 } } " ITN_CAMERA,
     {60, 0.87, 0.4}},
    {"knot, sun behind",
     "object { mesh { builtin: \"knot\" normalize: true } } " ITN_GROUND
     "lights { sun_sky { sun_angular_radius_degrees: 18.75 sun_azimuth_degrees: 180 } "
     "} " ITN_CAMERA,
     {100, 0.95, 0.6}},
    {"gear, low sun",
     "object { mesh { builtin: \"gear\" normalize: true } } " ITN_GROUND
     "lights { sun_sky { sun_elevation_degrees: 25 sun_azimuth_degrees: 60 "
     "sun_angular_radius_degrees: 5 } } " ITN_CAMERA,
     {44, 0.74, 0.2}},
    {"tree, lamp in a white room",
     "object { mesh { builtin: \"tree\" normalize: true } } " ITN_GROUND
     "lights { constant { radiance: 0.5 } } lights { directional { direction { x: 1 y: 1 z: -0.5 } "
     "irradiance: 3 } } " ITN_CAMERA,
     {150, 0.9, 0.7}},
    {"goblet, flash",
     "object { mesh { builtin: \"goblet\" normalize: true } } " ITN_GROUND
     "lights { directional { direction { y: 0.27 z: -1 } irradiance: 3 } } " ITN_CAMERA,
     {30, 0.59, 0.0}},
    {"figure, rough, unknown index and roughness",
     "object { mesh { builtin: \"figure\" normalize: true } rough_dielectric { index: 1.5 "
     "roughness: 0.3 } } " ITN_GROUND "lights { sun_sky { sun_angular_radius_degrees: 10 } "
     "} " ITN_CAMERA,
     {30, 0.9, 0.4},
     {{"rough_dielectric.index", 1.4}, {"rough_dielectric.roughness", 0.2}}},
}};

struct Options {
  uint32_t side = 64, image_spp = 1024, runs = 1;
  int scene = -1;
  std::string shape;
  std::string start = "mean";
  double near = 0.3;  // relative error of the start "near"
  v1::RefineSettings settings;
  int threads = 0;
  bool verbose = false, exposure = false;
};

Observation observe(RenderPool& pool, const Case& c, const Options& options, uint64_t seed) {
  v1::Scene scene;
  parse_text_proto(c.scene, c.name, scene);
  if (!options.shape.empty()) scene.mutable_object()->mutable_mesh()->set_builtin(options.shape);
  scene.mutable_film()->set_width(options.side);
  scene.mutable_film()->set_height(options.side);
  RenderJob job{.scene = serialize(scene), .request = {}};
  for (const auto& [name, truth] : c.unknowns) set_value(job.request, name, truth);
  *job.request.mutable_material() = to_proto(c.truth);
  job.request.set_spp(options.image_spp);
  job.request.set_seed(seed);
  job.request.set_pixels(v1::OBJECT_PIXELS);
  const v1::RenderGradReply reply = pool.render_split(job);
  return {.name = c.name,
          .radiance = mean_radiance(reply, options.image_spp),
          .mask = from_bytes<float>(reply.mask()),
          .noise = from_bytes<float>(reply.standard_error()),
          .scene = job.scene};
}

Material start_of(const Options& options, const Material& truth, uint64_t seed) {
  if (options.start == "mean") return {91, 0.67, 0.4};
  // The start is as far off as a good network.
  SplitMix random(seed);
  const auto sign = [&] { return 2 * random.uniform() - 1; };
  return {truth.sigma_t * std::exp(1.7 * options.near * sign()),
          std::clamp(truth.albedo + 0.12 * sign(), 0.05, 0.98),
          std::clamp(truth.g + 0.3 * sign(), -0.9, 0.9)};
}

// Counts for sigma_t, albedo, g and the unknowns of the scene.
struct Tally {
  struct Number {
    int inside = 0;  // the 95 % interval
    double squares = 0, variances = 0;
  };
  int runs = 0, close = 0;
  std::vector<Number> numbers;
  double iterations = 0, until_close = 0, cpu = 0, seconds = 0;
};

bool is_close(const Material& m, const Material& truth) {
  return std::abs(m.sigma_t / truth.sigma_t - 1) <= 0.02 &&
         std::abs(m.albedo / truth.albedo - 1) <= 0.02 && std::abs(m.g - truth.g) <= 0.03;
}

void run_one(RenderPool& pool, const Case& c, const Options& options, uint32_t run, Tally& tally) {
  const uint64_t seed = derive_seed(run + 1, {1});
  const std::vector<Observation> observations{observe(pool, c, options, seed)};
  v1::RefineSettings settings = options.settings;
  settings.set_seed(derive_seed(run + 1, {2}));
  settings.set_unknown_exposure(options.exposure);
  for (const auto& [name, truth] : c.unknowns) settings.add_unknowns(name);
  Refinement refinement(settings, observations,
                        {start_of(options, c.truth, derive_seed(run, {3}))});
  const Renderer renderer = rendered_by(pool);
  uint32_t last_far = 0;
  while (!refinement.finished()) {
    const v1::RefineIteration& i = refinement.step(renderer);
    if (!is_close(refinement.material(), c.truth)) last_far = i.iteration();
    if (options.verbose) {
      const Material next = refinement.material();
      fmt::print(
          "  {:3} spp {:5} at {:.4g} {:.4f} {:.4f} loss {:.3g} +- {:.2g}{} step/noise {:.2f} "
          "sd {:.4f} {:.4f} {:.4f} renders {:.2f} -> {:.4g} {:.4f} {:.4f} {:.1f} s\n",
          i.iteration(), i.spp(), i.materials(0).sigma_t(), i.materials(0).albedo(),
          i.materials(0).g(), i.loss(), i.loss_standard_error(), i.rejected() ? " rejected" : "",
          i.step_to_noise(), i.standard_deviations(0), i.standard_deviations(1),
          i.standard_deviations(2), i.render_noise_fraction(), next.sigma_t, next.albedo, next.g,
          i.seconds());
      std::fflush(stdout);
    }
  }
  const v1::RefineResult r = refinement.result();
  std::vector<std::pair<const v1::RefinedParameter*, double>> parameters = {
      {&r.sigma_t(), c.truth.sigma_t}, {&r.albedo(), c.truth.albedo}, {&r.g(), c.truth.g}};
  for (int i = 0; i < r.unknowns_size(); ++i)
    parameters.emplace_back(&r.unknowns(i), c.unknowns[static_cast<size_t>(i)].second);
  tally.numbers.resize(parameters.size());
  std::string line;
  for (size_t k = 0; k < parameters.size(); ++k) {
    const auto& [p, truth] = parameters[k];
    const bool inside = p->low_95() <= truth && truth <= p->high_95();
    const double scale = k < 2 ? truth : 1;
    tally.numbers[k].inside += inside;
    tally.numbers[k].squares += std::pow((p->value() - truth) / scale, 2);
    tally.numbers[k].variances += std::pow(p->standard_deviation() / scale, 2);
    line += fmt::format(" {:.4g} [{:.4g} {:.4g}]{}", p->value(), p->low_95(), p->high_95(),
                        inside ? " " : "*");
  }
  ++tally.runs;
  tally.close += is_close(refinement.material(), c.truth);
  tally.iterations += r.iterations();
  tally.until_close += last_far + 1;
  tally.cpu += r.cpu_seconds();
  tally.seconds += r.seconds();
  if (options.runs <= 5 || options.verbose) {
    fmt::print("{:30}{} {} iterations ({} until close), {}, {:.1f} CPU-s, {:.1f} s\n", c.name, line,
               r.iterations(), last_far + 1, v1::RefineResult::End_Name(r.end()), r.cpu_seconds(),
               r.seconds());
    for (const std::string& remark : r.remarks()) fmt::print("    {}\n", remark);
    std::fflush(stdout);
  }
}

void print(const char* name, const Tally& t) {
  const double n = t.runs;
  std::string errors, stated, inside;
  for (const Tally::Number& number : t.numbers) {
    errors += fmt::format(" {:.4f}", std::sqrt(number.squares / n));
    stated += fmt::format(" {:.4f}", std::sqrt(number.variances / n));
    inside += fmt::format(" {:.1f}", 100 * number.inside / n);
  }
  fmt::print(
      "{:30} {} runs: rms error{} (stated{}); in the 95 % intervals{} %; close {}; {:.1f} "
      "iterations, {:.1f} until close, {:.1f} CPU-s, {:.1f} s\n",
      name, t.runs, errors, stated, inside, t.close, t.iterations / n, t.until_close / n, t.cpu / n,
      t.seconds / n);
  std::fflush(stdout);
}

void run(const Options& options) {
  RenderPoolOptions pool_options;
  pool_options.embedded_threads = options.threads;
  RenderPool pool(pool_options);
  for (size_t i = 0; i < kCases.size(); ++i) {
    if (options.scene >= 0 && i != static_cast<size_t>(options.scene)) continue;
    Tally tally;
    for (uint32_t r = 0; r < options.runs; ++r) run_one(pool, kCases[i], options, r, tally);
    print(kCases[i].name, tally);
  }
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  using itn::v1::RefineSettings;
  itn::Options options;
  CLI::App app("Errors, coverage and time of itn refine on synthetic images");
  app.add_option("--side", options.side, "Pixels a side")->capture_default_str();
  app.add_option("--image-spp", options.image_spp, "Of the images")->capture_default_str();
  app.add_option("--runs", options.runs, "Of each scene, other seeds")->capture_default_str();
  app.add_option("--scene", options.scene, "One of them alone, from 0");
  app.add_option("--shape", options.shape, "A built-in shape instead of the scene's");
  app.add_option("--start", options.start, "mean, or near: as far off as a network")
      ->capture_default_str();
  app.add_flag("-v,--verbose", options.verbose, "Each iteration");
  app.add_flag("--unknown-exposure", options.exposure);
  app.add_option("--threads", options.threads);
  std::map<std::string, RefineSettings::Method> methods{{"gn", RefineSettings::GAUSS_NEWTON},
                                                        {"adam", RefineSettings::ADAM}};
  RefineSettings::Method method{};
  app.add_option("--method", method)->transform(CLI::CheckedTransformer(methods));
  std::map<std::string, RefineSettings::Weights> kinds{{"noise", RefineSettings::NOISE},
                                                       {"map", RefineSettings::MAP},
                                                       {"none", RefineSettings::NONE}};
  RefineSettings::Weights weights{};
  app.add_option("--weights", weights)->transform(CLI::CheckedTransformer(kinds));
  uint32_t spp = 0, max_spp = 0, max_iterations = 0;
  app.add_option("--spp", spp);
  app.add_option("--max-spp", max_spp);
  app.add_option("--max-iterations", max_iterations);
  CLI11_PARSE(app, argc, argv);
  options.settings.set_method(method);
  options.settings.set_weights(weights);
  options.settings.set_spp(spp);
  options.settings.set_max_spp(max_spp);
  options.settings.set_max_iterations(max_iterations);
  itn::run(options);
}
