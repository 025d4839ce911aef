#include "tests/bench/tracer_bits.h"

#include <fmt/format.h>
#include <hwy/targets.h>

#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "common/fields.h"
#include "common/geometry/mesh.h"
#include "common/geometry/shapes.h"
#include "common/scene/scene_bytes.h"
#include "server/tracer/render.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn {
namespace {

using namespace tracer;

// --- Scenes ---

constexpr int kWidth = 24, kHeight = 18;

// A square floor of 2 n^2 triangles.
DiffuseSurface floor_of(int n) {
  constexpr float kHalf = 20;
  Mesh mesh;
  const auto place = [n](int i) {
    return kHalf * (2 * static_cast<float>(i) / static_cast<float>(n) - 1);
  };
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) mesh.vertices.push_back({place(i), 0, place(j)});
  }
  const auto number = [n](int i, int j) { return static_cast<uint32_t>(i * (n + 1) + j); };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      mesh.triangles.push_back({number(i, j), number(i, j + 1), number(i + 1, j + 1)});
      mesh.triangles.push_back({number(i, j), number(i + 1, j + 1), number(i + 1, j)});
    }
  }
  return {std::move(mesh), 0.45F};
}

EnvironmentMapLight environment_map() {
  EnvironmentMapLight map{.width = 8, .height = 4, .rgb = {}, .scale = 2, .rotate_y = 0.7};
  for (int i = 0; i < 3 * map.width * map.height; ++i) {
    map.rgb.push_back(static_cast<float>(i * 37 % 11) * (i == 40 ? 30.0F : 1.0F));
  }
  return map;
}

// Written out, as digits of the defaults must not change the digests.
constexpr double kElevation = 1.0471976;

SceneDescription scene_of(const std::string& shape) {
  SceneDescription scene;
  scene.object = make_shape(shape);
  scene.camera = {.origin = {0, 9, -32.8}, .target = {0, 0.45, 0}, .fov = 0.05};
  scene.film = {kWidth, kHeight, Channel::kLuminance};
  return scene;
}

std::vector<std::pair<std::string, SceneDescription>> scenes() {
  std::vector<std::pair<std::string, SceneDescription>> result;
  SceneDescription mug = scene_of("mug");
  mug.surfaces = {floor_of(1)};
  mug.lights = {
      SunSkyLight{.sun_elevation = kElevation, .sun_azimuth = 0.9, .sun_angular_radius = 0.1}};
  result.emplace_back("mug_sun_floor", mug);
  SceneDescription many = std::move(mug);
  many.surfaces = {floor_of(7)};  // too many triangles to look at each
  result.emplace_back("mug_many_triangles", std::move(many));
  SceneDescription star = scene_of("smooth_star");
  star.surfaces = {floor_of(1)};
  star.lights = {environment_map(), ConstantLight{0.5}};
  star.film.channel = Channel::kGreen;
  result.emplace_back("star_map_constant", std::move(star));
  SceneDescription distant = scene_of("cube");
  distant.surfaces = {floor_of(1)};
  distant.lights = {DirectionalLight{.direction = {0.4, 0.8, -0.5}, .irradiance = 3}};
  result.emplace_back("cube_distant", std::move(distant));
  SceneDescription inside = scene_of("goblet");
  inside.lights = {ConstantLight{1},
                   SunSkyLight{.sun_elevation = kElevation, .sun_angular_radius = 0.00465}};
  inside.camera = {.origin = {0, 0.05, 0}, .target = {0.3, 0.5, 0.2}, .fov = 1.2};
  result.emplace_back("goblet_camera_inside", std::move(inside));
  SceneDescription posed = scene_of("gear");
  posed.surfaces = {floor_of(1)};
  posed.lights = {
      SunSkyLight{.sun_elevation = kElevation, .sun_azimuth = 2, .sun_angular_radius = 0.05}};
  posed.pose = {.rotation = {Vec3d{0, 0.6, -0.8}, Vec3d{0, 0.8, 0.6}, Vec3d{1, 0, 0}},
                .translation = {0.1, 0.6, 0.2}};
  SceneDescription lamp = posed;
  lamp.lights = {PointLight{{0.5, 1.5, 1}, 2e-6}, ConstantLight{0.1}};
  SceneDescription lamps = posed;
  lamps.lights = {SphereLight{{0.5, 1.5, 1}, 0.3, 2}, ConstantLight{0.1},
                  PanelLight{{-1, 1, 0.5}, {0.4, 0.4, 0}, {0, 0, 0.5}, 3}};
  result.emplace_back("gear_posed", std::move(posed));
  result.emplace_back("gear_lamp", std::move(lamp));
  SceneDescription smooth = scene_of("smooth_star");
  smooth.surfaces = {floor_of(1)};
  smooth.lights = {SunSkyLight{.sun_elevation = kElevation, .sun_angular_radius = 0.1}};
  smooth.boundary = Dielectric{1.5F};
  SceneDescription smooth_lamps = smooth;
  smooth_lamps.smooth_angle = 1;
  smooth_lamps.lights.insert(smooth_lamps.lights.end(), lamps.lights.begin(), lamps.lights.end());
  SceneDescription nearly_smooth = smooth_lamps;
  nearly_smooth.boundary = RoughDielectric{1.33F, 0.03F};
  SceneDescription rough = smooth;
  rough.lights.emplace_back(DirectionalLight{.direction = {0.4, 0.8, -0.5}, .irradiance = 3});
  rough.boundary = RoughDielectric{1.33F, 0.3F};
  SceneDescription interpolated = rough;
  interpolated.smooth_angle = 1;
  result.emplace_back("star_dielectric", std::move(smooth));
  result.emplace_back("star_rough_dielectric", std::move(rough));
  result.emplace_back("star_interpolated_normals", std::move(interpolated));
  result.emplace_back("gear_lamps", std::move(lamps));
  result.emplace_back("star_dielectric_lamps", std::move(smooth_lamps));
  result.emplace_back("star_nearly_smooth", std::move(nearly_smooth));
  return result;
}

// --- Requests ---

struct Ask {
  std::string name;
  RenderRequest request;
  RenderOptions options = {.threads = 2};
  bool of_reference = true;  // as well
};

const RenderRequest& plain_image() {
  static const RenderRequest image{
      .material = {80, 0.85, 0.3}, .sample_count = 8, .seed = 5, .estimates = 2};
  return image;
}

// Asks for the colours of a scene whose film shows kRgb.
Ask colours_of(const Scene& scene) {
  Ask ask{"colours", plain_image()};
  ask.of_reference = false;
  ask.request.colours = {{80, 0.85, 0.3}, {120, 0.7, 0.3}, {100, 0.4, 0.3}};
  ask.request.derivatives = medium_parameters();
  if (index_slot(scene.compiled().boundary)) {
    ask.request.derivatives.push_back(parameter_named("rough_dielectric.roughness"));
  }
  return ask;
}

// The places of its lights that images have derivatives in.
std::vector<Parameter> places_of(const Scene& scene) {
  std::vector<Parameter> places;
  const std::vector<Slot>& slots = slots_of<LightDescription>();
  for (uint32_t light = 0; light < scene.light_count(); ++light) {
    const Lights::Described& described = scene.compiled().lights.described(light);
    for (uint32_t slot = 0; slot < slots.size(); ++slot) {
      if (described.has_size && slots[slot].kind == described.kind) {
        places.push_back({Parameter::kLightPlace, light, slot});
      }
    }
  }
  return places;
}

// Whether paths follow edges of a rough boundary: for derivatives in its index, and in normals.
bool follows_edges(const Scene& scene) {
  const Scene::Compiled& compiled = scene.compiled();
  for (uint32_t light = 0; light < scene.light_count(); ++light) {
    if (!compiled.lights.described(light).has_size) return false;
  }
  return index_slot(compiled.boundary).has_value();
}

std::vector<Ask> asks(const Scene& scene) {
  if (scene.compiled().film.channel == Channel::kRgb) return {colours_of(scene)};
  const RenderRequest& image = plain_image();
  RenderRequest derivatives = image;
  derivatives.derivatives = medium_parameters();
  if (scene.surface_count() > 0) derivatives.derivatives.push_back({Parameter::kReflectance, 0});
  derivatives.derivatives.push_back({Parameter::kLightScale, 0});
  if (!is_delta(scene.compiled().boundary)) {
    derivatives.derivatives.push_back(parameter_named("rough_dielectric.roughness"));
  }
  std::vector<Ask> result = {{"image", image}, {"derivatives", derivatives}};
  const auto add = [&](const char* name, const auto& change, bool of_reference = true) {
    Ask& ask = result.emplace_back(Ask{name, derivatives});
    change(ask);
    ask.of_reference = of_reference;
  };
  add(
      "albedos",
      [](Ask& a) {
        a.request.albedos = {0.2, 0.6};
      },
      false);
  add(
      "pilot", [](Ask& a) { a.request.pilot_spp = 4; }, false);
  add("tile", [](Ask& a) { a.request.tile = Tile{8, 6, 9, 7}; });
  add("object_pixels", [](Ask& a) { a.request.pixels = Pixels::kObject; });
  add("backward", [](Ask& a) { a.request.material.g = -0.6; });
  add("white", [](Ask& a) { a.request.material.albedo = 1; });
  add("throughput_roulette", [](Ask& a) { a.options.switches.throughput_roulette = true; });
  add("unstratified", [](Ask& a) { a.options.switches.stratified = false; });
  add("lights_only",
      [](Ask& a) { a.options.switches.techniques = Switches::Techniques::kLightsOnly; });
  add("phase_only",
      [](Ask& a) { a.options.switches.techniques = Switches::Techniques::kPhaseOnly; });
  const std::vector<Parameter> places = places_of(scene);
  const Boundary& boundary = scene.compiled().boundary;
  if (!places.empty() && !(stops_lines(boundary) && is_delta(boundary))) {
    add(
        "places", [&](Ask& a) { a.request.derivatives = places; }, false);
  }
  if (follows_edges(scene)) {
    add("index",
        [](Ask& a) { a.request.derivatives = {parameter_named("rough_dielectric.index")}; });
    add(
        "normals",
        [&](Ask& a) {
          a.request.gradient_weights.assign(
              static_cast<size_t>(scene.width()) * static_cast<size_t>(scene.height()), 1);
          a.request.gradient_normals = true;
        },
        false);
  }
  return result;
}

// --- Digests ---

template <typename T>
void append(std::string& bytes, const std::vector<T>& values) {
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

std::string digest_of(const FilmSums& sums) {
  std::string bytes;
  append(bytes, std::vector{sums.quantum, sums.squares_quantum});
  append(bytes, sums.derivative_quanta);
  for (const FilmSums::EstimateSums& estimate : sums.estimates) {
    append(bytes, estimate.counts);
    append(bytes, estimate.radiance);
    for (const auto& plane : estimate.derivatives) append(bytes, plane);
    for (const auto& plane : estimate.other_media) append(bytes, plane);
    append(bytes, estimate.gradient);
    append(bytes, estimate.map_gradient);
    append(bytes, estimate.normal_gradient);
  }
  for (const auto& plane : sums.other_squares) append(bytes, plane);
  append(bytes, sums.squares);
  append(bytes, sums.hits);
  append(bytes, std::vector{sums.counters.paths, sums.counters.steps, sums.counters.invalid_samples,
                            sums.counters.leaks});
  return to_hex(sha256(bytes)).substr(0, 16);
}

}  // namespace

void print_bits() {
  std::vector<std::pair<std::string, SceneDescription>> all = scenes();
  for (auto& [name, description] : scenes()) {
    description.film.channel = Channel::kRgb;
    all.emplace_back(name, std::move(description));
  }
  for (auto& [name, description] : all) {
    const Scene scene(std::move(description));
    for (Ask& ask : asks(scene)) {
      const auto print = [&](const char* tracer) {
        fmt::print("{} {} {} {}\n", name, ask.name, tracer,
                   digest_of(render_grad(scene, ask.request, ask.options)));
      };
      const int64_t supported = hwy::SupportedTargets();
      for (const auto& [target, tracer] :
           {std::pair{HWY_AVX3, "avx512"}, {HWY_AVX2, "avx2"}, {HWY_SCALAR, "scalar"}}) {
        if (target != HWY_SCALAR && (supported & target) == 0) continue;
        hwy::SetSupportedTargetsForTest(target);
        print(tracer);
        hwy::SetSupportedTargetsForTest(0);
      }
      if (!ask.of_reference) continue;
      ask.request.tracer = Tracer::kReference;
      print("reference");
    }
  }
}

}  // namespace itn
