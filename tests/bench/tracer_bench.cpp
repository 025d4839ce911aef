// Speed and noise of the tracer against its reference. Prints JSON; tests/bench/run.sh makes it a
// table.
//
// Everything is measured on the pixels that see the object, on one thread, the tracers in turn. The
// noise of a pixel is its variance over renders with different seeds. That of the gradient of the
// loss sum_p (T_p - I_p)^2 is the sum over pixels of the variances of its terms, as pixels are
// independent: so a few renders of thousands of pixels measure it well.
#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/mesh.h"
#include "common/shapes.h"
#include "server/tracer/render.h"

namespace itn {
namespace {

using namespace tracer;

// The paper's set-up: the object on the ground under sun and sky, seen from 34 mm.
SceneDescription paper_scene(Mesh object, int resolution) {
  SceneDescription scene;
  scene.object = std::move(object);
  scene.surfaces.push_back(
      {{{{-20, 0, -20}, {-20, 0, 20}, {20, 0, 20}, {20, 0, -20}}, {{0, 1, 2}, {0, 2, 3}}}, 0.5F});
  SunSkyLight light;
  light.sun_angular_radius = 0.327;
  scene.lights = {light};
  const double middle = static_cast<double>(bounds(scene.object).max.y) / 2;
  scene.camera = {.origin = {0, middle + 8.78, -32.8}, .target = {0, middle, 0}, .fov = 0.0436};
  scene.film = {resolution, resolution, Channel::kLuminance};
  return scene;
}

// A built-in shape, or a mesh of the validation data; empty if that is not there.
Mesh find_mesh(const std::string& name, const std::string& folder) {
  const auto& shapes = builtin_shapes();
  if (std::any_of(shapes.begin(), shapes.end(), [&](const auto& s) { return s.name == name; })) {
    return make_shape(name);
  }
  const std::filesystem::path path = std::filesystem::path(folder) / "meshes" / (name + ".ply");
  return std::filesystem::exists(path) ? normalized(load_mesh(path)) : Mesh{};
}

// Mean and variance of many quantities over repetitions.
class Moments {
 public:
  void add(const std::vector<double>& values) {
    sum_.resize(values.size());
    squares_.resize(values.size());
    for (size_t i = 0; i < values.size(); ++i) {
      sum_[i] += values[i];
      squares_[i] += values[i] * values[i];
    }
    ++count_;
  }
  double total_mean() const {
    double total = 0;
    for (const double s : sum_) {
      total += s / count_;
    }
    return total;
  }
  double total_variance() const {
    double total = 0;
    for (size_t i = 0; i < sum_.size(); ++i) {
      total += std::max(0.0, squares_[i] - sum_[i] * sum_[i] / count_) / (count_ - 1);
    }
    return total;
  }

 private:
  std::vector<double> sum_, squares_;
  double count_ = 0;
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

struct Variant {
  std::string name;
  RenderSettings settings;
};

// What is known of a variant after its renders.
struct Tally {
  std::vector<double> cpu_seconds, steps_per_second;
  Moments image;
  std::array<Moments, kCoordinates> gradient;
  Counters counters;

  std::string json(const std::string& name) const {
    std::string text = fmt::format(
        "\"{}\": {{\"cpu_seconds\": {:.6g}, \"steps_per_second\": {:.6g}, \"steps\": {}, "
        "\"paths\": {}, \"leaks\": {}, \"invalid_samples\": {}, \"image\": [{:.6g}, {:.6g}]",
        name, median(cpu_seconds), median(steps_per_second), counters.steps, counters.paths,
        counters.leaks, counters.invalid_samples, image.total_mean(), image.total_variance());
    constexpr std::array kNames = {"sigma_t", "albedo", "g"};
    for (size_t c = 0; c < kCoordinates; ++c) {
      text += fmt::format(", \"{}\": [{:.6g}, {:.6g}]", kNames[c], gradient[c].total_mean(),
                          gradient[c].total_variance());
    }
    return text + "}";
  }
};

// The terms of the loss gradient, by pixel (see server/rendering_loss.h).
std::vector<double> gradient_terms(const RenderedImages& images, const std::vector<float>& target,
                                   size_t coordinate) {
  const auto count = static_cast<double>(images.estimates.size());
  std::vector<double> terms(target.size());
  for (size_t p = 0; p < target.size(); ++p) {
    double sum = 0, derivative_sum = 0, products = 0;
    for (const auto& estimate : images.estimates) {
      const double difference = static_cast<double>(estimate.radiance[p]) - target[p];
      const double derivative = estimate.derivatives[coordinate][p];
      sum += difference;
      derivative_sum += derivative;
      products += difference * derivative;
    }
    terms[p] = 2 * (sum * derivative_sum - products) / (count * (count - 1));
  }
  return terms;
}

std::vector<double> image_terms(const RenderedImages& images) {
  std::vector<double> terms(images.mask.size());
  for (const auto& estimate : images.estimates) {
    for (size_t p = 0; p < terms.size(); ++p) {
      terms[p] += static_cast<double>(estimate.radiance[p]) /
                  static_cast<double>(images.estimates.size());
    }
  }
  return terms;
}

// The image that the loss compares with: of a somewhat different material.
std::vector<float> target_image(const Scene& scene, const Material& material) {
  RenderSettings settings{.material = {material.sigma_t * 1.2, material.albedo - 0.03,
                                       std::min(0.9, material.g + 0.1)},
                          .sample_count = 256,
                          .seed = 99};
  settings.pixels = Pixels::kObject;
  return means(render_grad(scene, settings)).estimates[0].radiance;
}

std::vector<Tally> compare(const Scene& scene, std::vector<Variant> variants, int repetitions) {
  const std::vector<float> target = target_image(scene, variants[0].settings.material);
  std::vector<Tally> tallies(variants.size());
  for (int repetition = 0; repetition < repetitions; ++repetition) {
    for (size_t v = 0; v < variants.size(); ++v) {
      RenderSettings& settings = variants[v].settings;
      settings.seed = static_cast<uint64_t>(1 + repetition);
      settings.threads = 1;
      settings.pixels = Pixels::kObject;
      const FilmSums sums = render_grad(scene, settings);
      const RenderedImages images = means(sums);
      Tally& tally = tallies[v];
      tally.cpu_seconds.push_back(sums.counters.cpu_seconds);
      tally.steps_per_second.push_back(static_cast<double>(sums.counters.steps) /
                                       sums.counters.cpu_seconds);
      tally.image.add(image_terms(images));
      if (settings.derivatives && settings.estimates > 1) {
        for (size_t c = 0; c < kCoordinates; ++c) {
          tally.gradient[c].add(gradient_terms(images, target, c));
        }
      }
      tally.counters.steps += sums.counters.steps;
      tally.counters.paths += sums.counters.paths;
      tally.counters.leaks += sums.counters.leaks;
      tally.counters.invalid_samples += sums.counters.invalid_samples;
    }
  }
  return tallies;
}

constexpr std::array kMaterials = {Material{30, 0.39, 0}, Material{100, 0.87, 0.4},
                                   Material{100, 0.95, 0.5}, Material{276, 0.95, 0.8}};

Variant reference(const Material& material, uint32_t spp) {
  RenderSettings settings{
      .material = material, .sample_count = spp, .derivatives = true, .estimates = 2};
  settings.tracer = Tracer::kReference;
  return {"reference", settings};
}

Variant wavefront(const Material& material, uint32_t spp) {
  RenderSettings settings{
      .material = material, .sample_count = spp, .derivatives = true, .estimates = 4};
  settings.pilot_spp = 4;
  return {"wavefront", settings};
}

Variant changed(Variant variant, std::string name,
                const std::function<void(RenderSettings&)>& change) {
  change(variant.settings);
  variant.name = std::move(name);
  return variant;
}

// What every technique is worth: the wavefront without it.
std::vector<Variant> without_each(const Variant& full) {
  return {
      changed(full, "no connection roulette", [](auto& s) { s.connection_roulette = 0; }),
      changed(full, "usual walk roulette", [](auto& s) { s.walk_roulette = 0.05; }),
      changed(full, "no stratification", [](auto& s) { s.stratified = false; }),
      changed(full, "no baseline", [](auto& s) { s.baseline = 0; }),
      changed(full, "even samples", [](auto& s) { s.adaptive = false; }),
      changed(full, "no pilot", [](auto& s) { s.pilot_spp = 0; }),
      changed(full, "two estimates", [](auto& s) { s.estimates = 2; }),
  };
}

struct Options {
  std::string data;
  std::string only;
  uint32_t spp = 64;
  int repetitions = 4;
  int resolution = 128;
  bool each = false;
};

// Every scene and material: {"scene": ..., "material": [...], "variants": {...}} lines.
void compare_scenes(const Options& options) {
  for (const char* shape :
       {"sphere", "cube", "smooth_star", "leaf", "bunny", "armadillo", "dragon_40k"}) {
    if (!options.only.empty() && std::string(shape).find(options.only) == std::string::npos) {
      continue;
    }
    const Mesh mesh = find_mesh(shape, options.data);
    if (mesh.triangles.empty()) {
      fmt::print(stderr, "no {} in {}: left out\n", shape, options.data);
      continue;
    }
    const Scene scene(paper_scene(mesh, options.resolution));
    for (const Material& material : kMaterials) {
      std::vector<Variant> variants = {reference(material, options.spp),
                                       wavefront(material, options.spp)};
      variants.push_back(changed(variants[1], "image only", [](RenderSettings& s) {
        s.derivatives = false;
        s.estimates = 1;
      }));
      if (options.each) {
        for (Variant& variant : without_each(variants[1])) {
          variants.push_back(std::move(variant));
        }
      }
      const std::vector<Tally> tallies = compare(scene, variants, options.repetitions);
      std::string text;
      for (size_t v = 0; v < variants.size(); ++v) {
        text += (v > 0 ? ", " : "") + tallies[v].json(variants[v].name);
      }
      fmt::print("{{\"scene\": \"{}\", \"sigma_t\": {}, \"albedo\": {}, \"g\": {}, {}}}\n", shape,
                 material.sigma_t, material.albedo, material.g, text);
      std::fflush(stdout);
    }
  }
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::Options options;
  const char* data = std::getenv("ITN_VALIDATION_DATA");
  options.data = data != nullptr ? data : "../shared/data";
  CLI::App app("Speed and noise of the tracer against its reference; JSON, a line per row.");
  app.add_option("--data", options.data, "Folder with meshes/NAME.ply; what is missing is left out")
      ->capture_default_str();
  app.add_option("--only", options.only, "Scenes whose name contains this");
  app.add_option("--spp", options.spp, "Samples per pixel")->capture_default_str();
  app.add_option("--repetitions", options.repetitions, "Renders of each variant, at least 2")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  app.add_option("--resolution", options.resolution, "Of the square film")->capture_default_str();
  app.add_flag("--each", options.each, "Also the wavefront without each of its techniques");
  CLI11_PARSE(app, argc, argv);
  itn::compare_scenes(options);
}
