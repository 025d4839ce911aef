// Speed and noise of the tracer against its reference. Prints JSON; tests/bench/run.sh makes it a
// table.
//
// Everything is measured on the pixels that see the object, on one thread, the tracers in turn. The
// noise of a pixel is its variance over renders with different seeds. That of the gradient of the
// loss sum_p w_p^2 (T_p - I_p)^2 is the sum over pixels of the variances of its terms, as pixels
// are independent: so a few renders of thousands of pixels measure it well.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hwy/targets.h>
#include <time.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client/geometry/mesh_file.h"
#include "client/measured_media.h"
#include "common/geometry/mesh.h"
#include "common/geometry/shapes.h"
#include "common/learning/weight_map.h"
#include "common/scene/scene_bytes.h"
#include "server/render/render_reply.h"
#include "server/render/scene_cache.h"
#include "server/render/weighted_image_loss.h"
#include "server/scene_compiler/request_builder.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/render.h"
#include "server/tracer/scene/compiled_scene.h"
#include "tests/bench/tracer_bits.h"

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
    for (const double s : sum_) total += s / count_;
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

struct Options {
  std::string data;
  std::string only;
  std::string boundary = "matched";
  uint32_t spp = 64;
  int repetitions = 4;
  int resolution = 128;
  bool each = false;
  double paths = 1e9;
  std::string instructions = "best";
};

struct Variant {
  std::string name;
  RenderRequest request;
  RenderOptions options{.threads = 1};
  bool knows_loss = false;  // and puts its samples where that needs them
};

// What is known of a variant after its renders.
struct Tally {
  std::vector<double> cpu_seconds, steps_per_second;
  Moments image;
  std::array<Moments, 3> gradient;  // in sigma_t, albedo, g
  Counters counters;

  std::string json(const std::string& name) const {
    std::string text = fmt::format(
        "\"{}\": {{\"cpu_seconds\": {:.6g}, \"steps_per_second\": {:.6g}, \"steps\": {}, "
        "\"paths\": {}, \"leaks\": {}, \"invalid_samples\": {}, \"image\": [{:.6g}, {:.6g}]",
        name, median(cpu_seconds), median(steps_per_second), counters.steps, counters.paths,
        counters.leaks, counters.invalid_samples, image.total_mean(), image.total_variance());
    constexpr std::array kNames = {"sigma_t", "albedo", "g"};
    for (size_t c = 0; c < gradient.size(); ++c) {
      text += fmt::format(", \"{}\": [{:.6g}, {:.6g}]", kNames[c], gradient[c].total_mean(),
                          gradient[c].total_variance());
    }
    return text + "}";
  }
};

// The image that a loss compares with, and its weights, as in training.
struct Target {
  std::vector<float> image, weight, sampling_weights;
};

// The terms of the loss gradient, by pixel (see server/render/weighted_image_loss.h).
std::vector<double> gradient_terms(const RenderedImages& images, const Target& target,
                                   size_t coordinate) {
  const auto count = static_cast<double>(images.estimates.size());
  std::vector<double> terms(target.image.size());
  for (size_t p = 0; p < terms.size(); ++p) {
    double sum = 0, derivative_sum = 0, products = 0;
    for (const auto& estimate : images.estimates) {
      const double difference = static_cast<double>(estimate.radiance[p]) - target.image[p];
      const double derivative = estimate.derivatives[coordinate][p];
      sum += difference;
      derivative_sum += derivative;
      products += difference * derivative;
    }
    const double w2 = double{target.weight[p]} * target.weight[p];
    terms[p] = w2 * 2 * (sum * derivative_sum - products) / (count * (count - 1));
  }
  return terms;
}

std::vector<double> image_terms(const RenderedImages& images) {
  std::vector<double> terms(images.mask.size());
  for (const auto& estimate : images.estimates) {
    for (size_t p = 0; p < terms.size(); ++p) {
      terms[p] +=
          static_cast<double>(estimate.radiance[p]) / static_cast<double>(images.estimates.size());
    }
  }
  return terms;
}

// The target is of a somewhat different material.
Target make_target(const Scene& scene, const Material& material, int resolution) {
  RenderRequest request{
      .material = {material.sigma_t * 1.2, material.albedo - 0.03, std::min(0.9, material.g + 0.1)},
      .sample_count = 256,
      .seed = 99};
  request.pixels = Pixels::kObject;
  const RenderedImages images = means(render_grad(scene, request));
  Target target{images.estimates[0].radiance, {}, {}};
  target.weight = weight_map(resolution, resolution, target.image, images.mask);
  target.sampling_weights = loss_sampling_weights(target.image, target.weight);
  return target;
}

std::vector<Tally> compare(const Scene& scene, std::vector<Variant> variants,
                           const Options& options) {
  const Target target = make_target(scene, variants[0].request.material, options.resolution);
  std::vector<Tally> tallies(variants.size());
  for (int repetition = 0; repetition < options.repetitions; ++repetition) {
    for (size_t v = 0; v < variants.size(); ++v) {
      RenderRequest& request = variants[v].request;
      request.seed = static_cast<uint64_t>(1 + repetition);
      request.pixels = Pixels::kObject;
      if (variants[v].knows_loss) request.sampling_weights = target.sampling_weights;
      const FilmSums sums = render_grad(scene, request, variants[v].options);
      const RenderedImages images = means(sums);
      Tally& tally = tallies[v];
      tally.cpu_seconds.push_back(sums.counters.cpu_seconds);
      tally.steps_per_second.push_back(static_cast<double>(sums.counters.steps) /
                                       sums.counters.cpu_seconds);
      tally.image.add(image_terms(images));
      if (!request.derivatives.empty() && request.estimates > 1) {
        for (size_t c = 0; c < tally.gradient.size(); ++c) {
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
  RenderRequest request{.material = material,
                        .sample_count = spp,
                        .derivatives = medium_parameters(),
                        .estimates = 2};
  request.tracer = Tracer::kReference;
  return {.name = "reference", .request = request};
}

Variant wavefront(const Material& material, uint32_t spp) {
  RenderRequest request{.material = material,
                        .sample_count = spp,
                        .derivatives = medium_parameters(),
                        .estimates = 4};
  request.pilot_spp = 2;
  return {.name = "wavefront", .request = request, .knows_loss = true};
}

Variant changed(Variant variant, std::string name, const std::function<void(Variant&)>& change) {
  change(variant);
  variant.name = std::move(name);
  return variant;
}

// What every technique is worth: the wavefront without it.
std::vector<Variant> without_each(const Variant& full) {
  return {
      changed(full, "no shadow ray roulette",
              [](Variant& v) { v.options.tuning.shadow_ray_roulette = 0; }),
      changed(full, "usual walk roulette",
              [](Variant& v) { v.options.switches.throughput_roulette = true; }),
      changed(full, "no roulette by depth",
              [](Variant& v) { v.options.tuning.depth_roulette = 0; }),
      changed(full, "no stratification", [](Variant& v) { v.options.switches.stratified = false; }),
      changed(full, "no control variates",
              [](Variant& v) { v.options.tuning.control_variate = 0; }),
      changed(full, "even samples", [](Variant& v) { v.options.switches.adaptive = false; }),
      changed(full, "samples for the image", [](Variant& v) { v.knows_loss = false; }),
      changed(full, "no pilot", [](Variant& v) { v.request.pilot_spp = 0; }),
      changed(full, "two estimates", [](Variant& v) { v.request.estimates = 2; }),
  };
}

// Restricts the wavefront to some of the instruction sets that it is compiled for.
void use_instructions(const std::string& name) {
  if (name == "avx2") {
    hwy::SetSupportedTargetsForTest(HWY_AVX2);
  } else if (name == "none") {
    hwy::SetSupportedTargetsForTest(HWY_SCALAR);
  }
}

Boundary boundary_named(const std::string& name) {
  if (name == "smooth") return Dielectric{1.5F};
  if (name == "rough") return RoughDielectric{1.5F, 0.25F};
  return IndexMatched{};
}

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
    SceneDescription description = paper_scene(mesh, options.resolution);
    description.boundary = boundary_named(options.boundary);
    const Scene scene(std::move(description));
    for (const Material& material : kMaterials) {
      std::vector<Variant> variants = {reference(material, options.spp),
                                       wavefront(material, options.spp)};
      variants.push_back(changed(variants[1], "images", [](Variant& v) { v.knows_loss = false; }));
      variants.push_back(changed(variants[2], "image only", [](Variant& v) {
        v.request.derivatives.clear();
        v.request.estimates = 1;
        v.request.pilot_spp = 0;
      }));
      variants.push_back(changed(variants[0], "same walks", [](Variant& v) {
        v.request.tracer = Tracer::kWavefront;
        v.options.switches.throughput_roulette = true;
      }));
      if (options.each) {
        for (Variant& variant : without_each(variants[1])) variants.push_back(std::move(variant));
      }
      const std::vector<Tally> tallies = compare(scene, variants, options);
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

// The cube that the paper's own renderer was timed with, all pixels, the same samples in each.
void time_paper_scene(const Options& options) {
  const Material material{100, 0.8, 0.2};
  const Scene scene(paper_scene(make_shape("cube"), 128));
  std::vector<Variant> variants = {reference(material, 256), wavefront(material, 256)};
  variants[1].request.pilot_spp = 0;
  for (Variant& variant : variants) {
    std::vector<double> seconds;
    for (int i = 0; i < options.repetitions; ++i) {
      variant.request.seed = static_cast<uint64_t>(i);
      seconds.push_back(render_grad(scene, variant.request, variant.options).counters.cpu_seconds);
    }
    fmt::print("{{\"paper_scene\": \"{}\", \"cpu_seconds\": {:.4g}}}\n", variant.name,
               median(seconds));
  }
}

double wall_seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Most memory that the process ever had, in MB.
double peak_memory() {
  std::FILE* file = std::fopen("/proc/self/status", "r");
  char line[256];
  double kilobytes = 0;
  while (file != nullptr && std::fgets(line, sizeof line, file) != nullptr) {
    std::sscanf(line, "VmHWM: %lf", &kilobytes);
  }
  if (file != nullptr) std::fclose(file);
  return kilobytes / 1024;
}

// A ball of 4 n^2 triangles, with bumps.
Mesh bumpy_ball(int n) {
  Mesh mesh;
  const auto place = [&](int i, int j) {
    const double theta = M_PI * i / n, phi = M_PI * j / n;
    const double r = 0.45 * (1 + 0.05 * std::sin(9 * theta) * std::cos(7 * phi));
    return Vec3f{static_cast<float>(r * std::sin(theta) * std::cos(phi)),
                 static_cast<float>(r * std::cos(theta) + 0.5),
                 static_cast<float>(-r * std::sin(theta) * std::sin(phi))};
  };
  const auto number = [&](int i, int j) {
    return i == 0 ? 0U : i == n ? 1U : static_cast<uint32_t>(2 + (i - 1) * 2 * n + j % (2 * n));
  };
  mesh.vertices = {place(0, 0), place(n, 0)};
  for (int i = 1; i < n; ++i) {
    for (int j = 0; j < 2 * n; ++j) mesh.vertices.push_back(place(i, j));
  }
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < 2 * n; ++j) {
      const uint32_t a = number(i, j), b = number(i + 1, j), c = number(i + 1, j + 1),
                     d = number(i, j + 1);
      if (i + 1 < n) mesh.triangles.push_back({a, b, c});
      if (i > 0) mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

// How time and memory grow with pixels, samples, triangles and albedo: image and three derivatives,
// all threads. From small to large, as the peak of memory never falls.
void measure_scaling(const Options&) {
  const auto row = [](const std::string& what, int resolution, uint32_t spp, int n,
                      const Material& material = {100, 0.87, 0.4}) {
    const Mesh mesh = bumpy_ball(n);
    std::unique_ptr<Scene> scene;
    const double set_up =
        wall_seconds([&] { scene = std::make_unique<Scene>(paper_scene(mesh, resolution)); });
    RenderRequest request{
        .material = material, .sample_count = spp, .derivatives = medium_parameters()};
    double cpu = 0;
    const double wall =
        wall_seconds([&] { cpu = render_grad(*scene, request).counters.cpu_seconds; });
    fmt::print(
        "{{\"scaling\": \"{}\", \"resolution\": {}, \"spp\": {}, \"triangles\": {}, "
        "\"sigma_t\": {}, \"albedo\": {}, \"set_up_seconds\": {:.4g}, \"wall_seconds\": {:.4g}, "
        "\"cpu_seconds\": {:.4g}, "
        "\"peak_mb\": {:.0f}}}\n",
        what, resolution, spp, mesh.triangles.size(), material.sigma_t, material.albedo, set_up,
        wall, cpu, peak_memory());
    std::fflush(stdout);
  };
  for (const uint32_t spp : {1U, 16U, 64U, 256U, 1024U}) row("spp", 128, spp, 64);
  for (const int resolution : {32, 64, 128, 256, 512, 1024}) {
    row("pixels", resolution, resolution > 512 ? 16 : 64, 64);
  }
  for (const int n : {16, 50, 158, 500}) row("triangles", 128, 64, n);
  for (const double sigma_t : {100.0, 500.0}) {
    for (const double albedo : {0.99, 0.999, 0.9999})
      row("albedo", 64, 32, 64, {sigma_t, albedo, 0});
  }
}

// ---- Where the time of a small render goes --------------------------------------------------

double process_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// CPU time by step, in milliseconds, in the order of the steps' first appearance; of all threads.
class Steps {
 public:
  template <typename Work>
  auto time(const std::string& step, const Work& work) {
    const double start = process_cpu_seconds();
    auto result = work();
    entry(step).push_back(1e3 * (process_cpu_seconds() - start));
    return result;
  }
  void print(const std::string& head) const {
    std::string text = head;
    double sum = 0;
    for (const auto& [step, values] : steps_) {
      text += fmt::format(", \"{}\": {:.3g}", step, median(values));
      sum += median(values);
    }
    fmt::print("{}, \"all\": {:.3g}}}\n", text, sum);
    std::fflush(stdout);
  }

 private:
  std::vector<double>& entry(const std::string& step) {
    for (auto& [name, values] : steps_) {
      if (name == step) return values;
    }
    return steps_.emplace_back(step, std::vector<double>()).second;
  }
  std::vector<std::pair<std::string, std::vector<double>>> steps_;
};

// The paper's set-up as it comes over the wire.
v1::Scene wire_scene(const Mesh& mesh, int resolution) {
  v1::Scene scene;
  set_triangles(*scene.mutable_object()->mutable_mesh(), mesh);
  v1::Rectangle& ground = *scene.add_surfaces()->mutable_rectangle();
  ground.mutable_center();
  ground.mutable_half_u()->set_x(20);
  ground.mutable_half_v()->set_z(-20);
  v1::SunSky& sky = *scene.add_lights()->mutable_sun_sky();
  sky.set_turbidity(3);
  sky.set_sun_elevation_degrees(60);
  sky.set_sun_angular_radius_degrees(18.75F);
  v1::Camera& camera = *scene.mutable_camera();
  camera.mutable_origin()->set_y(8.78F);
  camera.mutable_origin()->set_z(-32.8F);
  camera.mutable_target()->set_y(0.5F);
  camera.set_fov_degrees(2.5F);
  scene.mutable_film()->set_width(static_cast<uint32_t>(resolution));
  scene.mutable_film()->set_height(static_cast<uint32_t>(resolution));
  return scene;
}

// What a worker does for a request, step by step. `digest`: of a scene that is held.
void answer(const std::string& bytes, const v1::RenderGradRequest& request, SceneCache& cache,
            Steps& steps) {
  const std::string digest = steps.time("hash", [&] { return sha256(bytes); });
  const auto scene = steps.time("scene", [&] {
    return cache.get_or_build(digest, [&] {
      return std::make_shared<const Scene>(
          build_scene(parse_scene(bytes), RenderLimits(), &cache.parts()), cache.parts());
    });
  });
  const BuiltRequest built = build_request(request, RenderLimits());
  steps.time("object pixels", [&] { return scene->compiled().object_pixels().size(); });
  const FilmSums sums = steps.time("paths", [&] { return render_grad(*scene, built.asked); });
  steps.time("reply", [&] {
    return make_reply(sums, request, built.derivative_weights).SerializeAsString().size();
  });
}

// What of a scene is new to the worker.
enum class New { kNothing, kPose, kSunAzimuth, kCameraHeight, kMesh };

void set_up_row(New what, const char* name, int resolution, uint32_t spp, int repetitions) {
  constexpr int kRings = 71;  // 20 k triangles
  v1::RenderGradRequest request;
  *request.mutable_scene() = "as it comes";
  request.mutable_material()->set_sigma_t(100);
  request.mutable_material()->set_albedo(0.87);
  request.mutable_material()->set_g(0.4);
  request.set_spp(spp);
  request.set_pixels(v1::OBJECT_PIXELS);
  SceneCache cache(size_t{1} << 30);
  const Mesh mesh = bumpy_ball(kRings);
  Steps ignored, steps;
  answer(wire_scene(mesh, resolution).SerializeAsString(), request, cache, ignored);
  for (int i = 1; i <= repetitions; ++i) {
    Mesh other = mesh;
    if (what == New::kMesh) other.vertices[0].y += 1e-4F * static_cast<float>(i);
    v1::Scene scene = wire_scene(other, resolution);
    if (what == New::kPose) {
      v1::Rotation& turn =
          *scene.mutable_object()->mutable_mesh()->add_transforms()->mutable_rotate();
      turn.mutable_axis()->set_y(1);
      turn.set_angle_degrees(10.0F * static_cast<float>(i));
    } else if (what == New::kSunAzimuth) {
      scene.mutable_lights(0)->mutable_sun_sky()->set_sun_azimuth_degrees(10.0F *
                                                                          static_cast<float>(i));
    } else if (what == New::kCameraHeight) {
      scene.mutable_camera()->mutable_origin()->set_y(8.78F + 0.1F * static_cast<float>(i));
    }
    answer(scene.SerializeAsString(), request, cache, steps);
  }
  steps.print(
      fmt::format("{{\"set_up\": \"{}\", \"resolution\": {}, \"spp\": {}", name, resolution, spp));
}

// What compiling a new mesh and a new sky consists of.
void parts_row(int repetitions) {
  const Mesh mesh = bumpy_ball(71);
  const std::string bytes = wire_scene(mesh, 64).SerializeAsString();
  Steps steps;
  for (int i = 0; i < repetitions; ++i) {
    const v1::Scene scene = steps.time("parse", [&] { return parse_scene(bytes); });
    const SceneDescription description =
        steps.time("weld and check", [&] { return build_scene(scene, RenderLimits()); });
    steps.time("validate closed", [&] {
      validate_closed(description.object, "object");
      return 0;
    });
    steps.time("grid", [&] { return Grid(description.object).memory(); });
    steps.time("depths", [&] { return DepthGrid(description.object).memory(); });
    steps.time("camera inside",
               [&] { return winding_number(description.object, description.camera.origin); });
    steps.time("lights",
               [&] { return Lights(description.lights, description.film.channel).power(); });
  }
  steps.print(fmt::format("{{\"parts_of\": {}", mesh.triangles.size()));
}

// Measures where the CPU time of a small render goes, in milliseconds: medians over renders of the
// pixels of an object of 20 k triangles, of which more and more is known to the worker.
void measure_set_up(const Options& options) {
  parts_row(options.repetitions);
  for (const int resolution : {64, 128}) {
    for (const uint32_t spp : {4U, 16U, 64U}) {
      const auto row = [&](New what, const char* name) {
        set_up_row(what, name, resolution, spp, options.repetitions);
      };
      row(New::kNothing, "held");
      row(New::kPose, "new pose");
      row(New::kSunAzimuth, "new sun azimuth");
      row(New::kCameraHeight, "new camera height");
      row(New::kMesh, "new mesh");
    }
  }
}

// Training renders (three derivatives, a loss, a pilot) a second of the held scene, on all threads.
void measure_training(const Options& options) {
  constexpr int kResolution = 128;
  const Scene scene(paper_scene(bumpy_ball(71), kResolution));
  const Target target = make_target(scene, kMaterials[1], kResolution);
  for (const uint32_t spp : {4U, 16U, 64U}) {
    Variant variant = wavefront(kMaterials[1], spp);
    variant.request.pixels = Pixels::kObject;
    variant.request.sampling_weights = target.sampling_weights;
    variant.options.threads = 0;  // all
    const double wall = wall_seconds([&] {
      for (int i = 0; i < options.repetitions; ++i) {
        variant.request.seed = static_cast<uint64_t>(i);
        render_grad(scene, variant.request, variant.options);
      }
    });
    fmt::print("{{\"training\": {}, \"spp\": {}, \"renders_per_second\": {:.4g}}}\n", kResolution,
               spp, options.repetitions / wall);
  }
}

// What datasets cost: images of 2 % error (root mean square over the object's pixels, relative to
// their mean) per CPU-hour. `albedos` share the paths of one walk.
void measure_dataset(const Options& options) {
  struct Kind {
    const char* name;
    std::vector<double> albedos;  // below that of the material
  };
  const Kind kinds[] = {{"grid of the paper", {0.87, 0.74, 0.59, 0.39}}, {"random materials", {}}};
  constexpr std::array kGridSigmaT = {30.,  36.,  44.,  54.,  67.,  82.,
                                      100., 122., 150., 184., 225., 276.};
  for (const Kind& kind : kinds) {
    double cpu_for_target = 0, images = 0;
    int renders = 0;
    for (const char* shape :
         {"cube", "smooth_star", "figure", "bunny", "armadillo", "dragon_40k"}) {
      const Mesh mesh = find_mesh(shape, options.data);
      if (mesh.triangles.empty()) continue;
      const Scene scene(paper_scene(mesh, options.resolution));
      for (size_t i = 0; i < kGridSigmaT.size(); ++i, ++renders) {
        // A Latin square over the grid; random materials: golden ratio points of the same ranges.
        const double golden = std::fmod(0.5 + 0.6180339887 * (renders + 1), 1.0);
        const bool grid = !kind.albedos.empty();
        const double g =
            grid ? 0.2 * static_cast<double>((i + static_cast<size_t>(renders / 12)) % 5)
                 : 0.8 * golden;
        const double albedo = grid ? 0.95 : 0.39 + 0.56 * std::fmod(golden * 7, 1.0);
        RenderRequest request{.material = {kGridSigmaT[i], albedo, g}, .sample_count = 64};
        request.pixels = Pixels::kObject;
        request.albedos = kind.albedos;
        std::vector<RenderedImages> pair;
        double cpu = 0;
        for (uint64_t seed : {1U, 2U}) {
          request.seed = seed;
          const FilmSums sums = render_grad(scene, request, {.threads = 1});
          cpu += sums.counters.cpu_seconds / 2;
          pair.push_back(means(sums));
        }
        const auto share = [&](const auto& image_of) {
          double squares = 0, sum = 0;
          int pixels = 0;
          for (size_t p = 0; p < pair[0].mask.size(); ++p) {
            if (pair[0].mask[p] > 0.99F) {
              const double a = image_of(pair[0])[p], b = image_of(pair[1])[p];
              squares += (a - b) * (a - b) / 2;
              sum += (a + b) / 2;
              ++pixels;
            }
          }
          return squares / pixels / std::pow(sum / pixels, 2) / (0.02 * 0.02);
        };
        // All images of a walk get the samples that the noisiest needs.
        double worst = share([](const RenderedImages& r) { return r.estimates[0].radiance; });
        for (size_t a = 0; a < kind.albedos.size(); ++a) {
          worst = std::max(
              worst, share([a](const RenderedImages& r) { return r.estimates[0].other_media[a]; }));
        }
        cpu_for_target += cpu * worst;
        images += 1 + static_cast<double>(kind.albedos.size());
      }
    }
    const double per_hour = images / cpu_for_target * 3600;
    fmt::print(
        "{{\"dataset\": \"{}\", \"images\": {}, \"images_per_cpu_hour\": {:.4g}, "
        "\"hours_for_14400_on_2_cores\": {:.4g}}}\n",
        kind.name, images, per_hour, 14400 / per_hour / 2);
  }
}

// CPU time of a gradient in numbers, in numbers and the pixels of a panorama, and of derivative
// images, over that of the image alone; and of the image from walks as long as theirs.
void measure_gradient(const Options& options) {
  EnvironmentMapLight map{.width = 512, .height = 256, .rgb = {}};
  for (int i = 0; i < map.width * map.height; ++i) {
    const auto bright = static_cast<float>(1 + i % 97 * (i / map.width % 5));
    map.rgb.insert(map.rgb.end(), {bright, bright, bright});
  }
  for (const Material& material : kMaterials) {
    SceneDescription description = paper_scene(make_shape("smooth_star"), options.resolution);
    description.lights.emplace_back(map);
    const Scene scene(std::move(description));
    const RenderRequest image{.material = material, .sample_count = 64};
    RenderRequest derivatives = image;
    derivatives.derivatives = medium_parameters();
    derivatives.derivatives.push_back({Parameter::kReflectance, 0});
    for (uint32_t k : {0U, 1U}) derivatives.derivatives.push_back({Parameter::kLightScale, k});
    RenderRequest gradient = derivatives;
    gradient.gradient_weights.assign(static_cast<size_t>(scene.width()) * scene.height(), 1);
    RenderRequest in_pixels = gradient;
    in_pixels.gradient_light = 1;
    const RenderOptions as_long{
        .tuning = {.walk_roulette = material.sigma_t < 50 ? 0.2 : 0.25, .depth_roulette = 0.5}};
    std::vector<std::vector<double>> seconds(5);
    for (int repetition = 0; repetition < options.repetitions; ++repetition) {
      size_t kind = 0;
      for (RenderRequest request : {image, derivatives, gradient, in_pixels}) {
        request.seed = static_cast<uint64_t>(repetition);
        seconds[kind++].push_back(render_grad(scene, request).counters.cpu_seconds);
      }
      seconds[kind].push_back(render_grad(scene, image, as_long).counters.cpu_seconds);
    }
    const auto ratio = [&](size_t kind) { return median(seconds[kind]) / median(seconds[0]); };
    fmt::print(
        "{{\"sigma_t\": {}, \"albedo\": {}, \"g\": {}, \"image_cpu_seconds\": {:.3g}, "
        "\"six_derivative_images\": {:.3f}, \"gradient_in_six\": {:.3f}, "
        "\"and_in_131072_pixels\": {:.3f}, \"image_of_walks_as_long\": {:.3f}}}\n",
        material.sigma_t, material.albedo, material.g, median(seconds[0]), ratio(1), ratio(2),
        ratio(3), ratio(4));
  }
}

// What a colour image costs whose three media share their paths, over one of its channels alone, at
// equal noise: variance times CPU time, the mean over the channels. Three renders cost 3. Media
// whose sigma_t differ by up to 2, and the measured ones as if the object were 3 or 30 mm large.
void measure_colours(const Options& options) {
  struct Row {
    std::string name;
    std::array<double, 3> sigma_t, albedo;  // the object being 1 mm large
  };
  std::vector<Row> rows{{"albedos alone", {60, 60, 60}, {.95, .8, .5}},
                        {"albedos alone, pale", {200, 200, 200}, {.999, .995, .97}},
                        {"dark", {60, 78, 120}, {.3, .5, .7}},
                        {"grey", {60, 78, 120}, {.9, .9, .9}},
                        {"pale", {60, 78, 120}, {.97, .96, .95}}};
  for (const MeasuredMedium& medium : measured_media()) {
    for (const double size : {3, 30}) {
      Row row{fmt::format("{}, {} mm", medium.name, size), {}, {}};
      for (size_t c = 0; c < row.sigma_t.size(); ++c) {
        row.sigma_t[c] = medium.material(c).sigma_t * size;
        row.albedo[c] = medium.material(c).albedo;
      }
      const auto [least, most] = std::ranges::minmax(row.sigma_t);
      if (least >= 1 && most <= 2000) rows.push_back(row);
    }
  }
  SceneDescription description = paper_scene(make_shape("smooth_star"), options.resolution);
  description.boundary = boundary_named(options.boundary);
  const auto scene_in = [&](Channel channel) {
    description.film.channel = channel;
    return std::make_unique<const Scene>(description);
  };
  const std::unique_ptr<const Scene> all = scene_in(Channel::kRgb);
  std::array<std::unique_ptr<const Scene>, 3> own;
  for (size_t c = 0; c < own.size(); ++c) own[c] = scene_in(kColours[c]);
  for (const Row& row : rows) {
    constexpr double kG = 0.3;
    RenderRequest request{
        .material = {std::ranges::min(row.sigma_t), std::ranges::max(row.albedo), kG},
        .sample_count = options.spp};
    request.pixels = Pixels::kObject;
    for (size_t c = 0; c < own.size(); ++c) {
      request.colours.push_back({row.sigma_t[c], row.albedo[c], kG});
    }
    std::array<Moments, 3> shared, alone;
    std::vector<double> shared_seconds;
    std::array<std::vector<double>, 3> alone_seconds;
    for (int repetition = 0; repetition < options.repetitions; ++repetition) {
      request.seed = static_cast<uint64_t>(repetition);
      const FilmSums sums = render_grad(*all, request, {.threads = 1});
      shared_seconds.push_back(sums.counters.cpu_seconds);
      const RenderedImages images = means(sums);
      for (size_t c = 0; c < own.size(); ++c) {
        const std::vector<float>& image = images.estimates[0].other_media[c];
        shared[c].add({image.begin(), image.end()});
        RenderRequest one = request;
        one.material = request.colours[c];
        one.colours.clear();
        one.seed += 1000 * (c + 1);
        const FilmSums own_sums = render_grad(*own[c], one, {.threads = 1});
        alone_seconds[c].push_back(own_sums.counters.cpu_seconds);
        alone[c].add(image_terms(means(own_sums)));
      }
    }
    std::array<double, 3> noise{};
    double noises = 0, seconds = 0;
    for (size_t c = 0; c < own.size(); ++c) {
      noise[c] = shared[c].total_variance() / alone[c].total_variance();
      noises += noise[c] / 3;
      seconds += median(alone_seconds[c]) / 3;
    }
    const double time = median(shared_seconds) / seconds;
    fmt::print(
        "{{\"colours\": \"{}\", \"sigma_t\": [{:.4g}], \"albedo\": [{:.4g}], "
        "\"variance\": [{:.3g}], \"cpu\": {:.3g}, \"cost\": {:.3g}}}\n",
        row.name, fmt::join(row.sigma_t, ", "), fmt::join(row.albedo, ", "), fmt::join(noise, ", "),
        time, noises * time);
    std::fflush(stdout);
  }
}

// Renders until so many paths are traced, across shapes, materials and views, and counts what went
// wrong.
void soak(const Options& options) {
  Counters total;
  const auto& shapes = builtin_shapes();
  std::vector<std::string> names;
  for (const auto& shape : shapes) names.emplace_back(shape.name);
  for (const char* name : {"bunny", "armadillo", "dragon_40k"}) names.emplace_back(name);
  for (uint64_t round = 0; static_cast<double>(total.paths) < options.paths; ++round) {
    for (const std::string& name : names) {
      const Mesh mesh = find_mesh(name, options.data);
      if (mesh.triangles.empty()) continue;
      const Scene scene(paper_scene(mesh, options.resolution));
      for (const Material& material : kMaterials) {
        RenderRequest request{.material = material,
                              .sample_count = 32,
                              .seed = round,
                              .derivatives = medium_parameters()};
        const Counters counters = render_grad(scene, request).counters;
        total.paths += counters.paths;
        total.steps += counters.steps;
        total.leaks += counters.leaks;
        total.invalid_samples += counters.invalid_samples;
      }
    }
    fmt::print(stderr, "{:.3g} paths, {:.3g} steps, {} leaks, {} invalid\n",
               static_cast<double>(total.paths), static_cast<double>(total.steps), total.leaks,
               total.invalid_samples);
  }
  fmt::print("{{\"soak_paths\": {}, \"steps\": {}, \"leaks\": {}, \"invalid_samples\": {}}}\n",
             total.paths, total.steps, total.leaks, total.invalid_samples);
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::Options options;
  const char* data = std::getenv("ITN_VALIDATION_DATA");
  options.data = data != nullptr ? data : "../shared/data";
  CLI::App app("Speed and noise of the tracer; JSON, a line per row.");
  app.require_subcommand(1);
  app.fallthrough();
  app.add_option("--data", options.data, "Folder with meshes/NAME.ply; what is missing is left out")
      ->capture_default_str();
  app.add_option("--instructions", options.instructions,
                 "That the wavefront may use; best: all that the processor has")
      ->check(CLI::IsMember({"best", "avx2", "none"}))
      ->capture_default_str();
  app.add_option("--resolution", options.resolution, "Of the square film")->capture_default_str();
  app.add_option("--repetitions", options.repetitions, "Renders of each variant, at least 2")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  const auto add = [&](const char* name, const char* what, void (*run)(const itn::Options&)) {
    CLI::App* command = app.add_subcommand(name, what);
    command->callback([&options, run] {
      itn::use_instructions(options.instructions);
      run(options);
    });
    return command;
  };
  CLI::App* compare = add("compare", "Wavefront against reference", itn::compare_scenes);
  CLI::App* colours =
      add("colours", "Colours that share their paths, over one of them", itn::measure_colours);
  compare->add_option("--only", options.only, "Scenes whose name contains this");
  for (CLI::App* command : {compare, colours}) {
    command->add_option("--boundary", options.boundary, "Of the objects, of index 1.5")
        ->check(CLI::IsMember({"matched", "smooth", "rough"}))
        ->capture_default_str();
    command->add_option("--spp", options.spp, "Samples per pixel")->capture_default_str();
  }
  compare->add_flag("--each", options.each, "Also the wavefront without each of its techniques");
  add("paper", "The cube that the paper's renderer was timed with", itn::time_paper_scene);
  add("scaling", "Time and memory by pixels, samples, triangles and albedo", itn::measure_scaling);
  add("dataset", "Images of 2 % error per CPU-hour", itn::measure_dataset);
  add("setup", "Where the time of a small render goes", itn::measure_set_up);
  add("training", "Renders with a loss a second", itn::measure_training);
  add("gradient", "Time of gradients, over that of the image", itn::measure_gradient);
  add("soak", "Counts leaks and invalid samples", itn::soak)
      ->add_option("--paths", options.paths, "To trace at least")
      ->capture_default_str();
  app.add_subcommand("bits", "Digests of all sums: to compare two builds by")
      ->callback(itn::print_bits);
  CLI11_PARSE(app, argc, argv);
}
