#include "tests/server/tracer/random_scenes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "common/geometry/shapes.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {

using namespace tracer;

namespace {

using std::numbers::pi;

// Rotation about y.
Vec3d about_y(Vec3d v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x + s * v.z, v.y, -s * v.x + c * v.z};
}

// Calls f(vector) with all places, and then with all directions and edges, of a light.
template <typename Place, typename Direction>
void move(LightDescription& light, const Place& place, const Direction& direction) {
  if (auto* point = std::get_if<PointLight>(&light)) place(point->position);
  if (auto* spot = std::get_if<SpotLight>(&light)) {
    place(spot->position);
    place(spot->target);
  }
  if (auto* sphere = std::get_if<SphereLight>(&light)) place(sphere->center);
  if (auto* panel = std::get_if<PanelLight>(&light)) {
    place(panel->center);
    direction(panel->half_u);
    direction(panel->half_v);
  }
}

template <typename F>
void move(Mesh& mesh, const F& f) {
  for (Vec3f& v : mesh.vertices) {
    auto wide = static_cast<Vec3d>(v);
    f(wide);
    v = static_cast<Vec3f>(wide);
  }
}

// Places, and directions or edges, of a scene whose object has no pose.
template <typename Place, typename Direction>
void move(SceneDescription& scene, const Place& place, const Direction& direction) {
  move(scene.object, place);
  for (OtherObject& other : scene.other_objects) move(other.mesh, place);
  for (DiffuseSurface& surface : scene.surfaces) {
    move(surface.mesh, place);
    if (auto* board = std::get_if<Checkerboard>(&surface.reflectance)) {
      place(board->corner);
      direction(board->edge_u);
      direction(board->edge_v);
    }
  }
  for (LightDescription& light : scene.lights) move(light, place, direction);
  place(scene.camera.origin);
  place(scene.camera.target);
}

double brightness(LightDescription& light, double factor) {
  return std::visit(
      [&](auto& kind) -> double {
        using Kind = std::decay_t<decltype(kind)>;
        if constexpr (requires { kind.radiance; }) return kind.radiance *= factor;
        if constexpr (requires { kind.irradiance; }) return kind.irradiance *= factor;
        if constexpr (requires { kind.intensity; }) return kind.intensity *= factor;
        if constexpr (std::is_same_v<Kind, SunSkyLight>) {
          kind.sun_scale *= factor;
          return kind.sky_scale *= factor;
        }
        if constexpr (requires { kind.scale; }) return kind.scale *= factor;
        return 0;
      },
      light);
}

void cut(Mesh& mesh) {
  const std::vector<std::array<uint32_t, 3>> before = std::move(mesh.triangles);
  mesh.triangles.clear();
  // About a point inside, so that closed meshes stay closed.
  for (const auto& [a, b, c] : before) {
    const auto middle = static_cast<uint32_t>(mesh.vertices.size());
    const auto corner = [&](uint32_t v) { return static_cast<Vec3d>(mesh.vertices[v]); };
    mesh.vertices.push_back(
        static_cast<Vec3f>(corner(a) * 0.2 + corner(b) * 0.3 + corner(c) * 0.5));
    mesh.triangles.insert(mesh.triangles.end(), {{a, b, middle}, {b, c, middle}, {c, a, middle}});
  }
}

class Dice {
 public:
  explicit Dice(uint64_t number) : engine_(number * 0x9E3779B97F4A7C15 + 1) {}

  double uniform(double low, double high) {
    // std::uniform_real_distribution differs between libraries.
    const double u = static_cast<double>(engine_() >> 11U) * 0x1p-53;
    return low + (high - low) * u;
  }
  // Evenly by exponents.
  double by_exponent(double low, double high) { return low * std::pow(high / low, uniform(0, 1)); }
  int below(int n) { return static_cast<int>(uniform(0, n)); }
  bool once_in(int n) { return below(n) == 0; }
  Vec3d direction(double least_y = -1) {
    const double y = uniform(least_y, 1), angle = uniform(0, 2 * pi);
    const double r = std::sqrt(std::max(0.0, 1 - y * y));
    return {r * std::cos(angle), y, r * std::sin(angle)};
  }

 private:
  std::mt19937_64 engine_;
};

// In units of the object's size. Behind a smooth boundary, the reference finds none that is small.
LightDescription random_light(Dice& dice, bool needs_size, std::string& what) {
  const double least_angle = needs_size ? 0.15 : 0.005;
  const Vec3d place = dice.direction(-0.2) * dice.by_exponent(1.5, 30) + Vec3d{0, 0.5, 0};
  const double distance = length(place);
  const int kind = dice.below(needs_size ? 6 : 8);
  switch (kind) {
    case 0: what += " constant"; return ConstantLight{dice.by_exponent(1e-3, 1e3)};
    case 1:
      what += " directional";
      return DirectionalLight{dice.direction(-0.3), dice.by_exponent(1e-2, 1e2),
                              dice.by_exponent(least_angle, 0.7)};
    case 2: {
      const double radius =
          std::min(needs_size ? distance : dice.by_exponent(1e-3, 3), distance / 4);
      what += fmt::format(" sphere {:.2g}", radius);
      return SphereLight{place, radius, dice.by_exponent(0.1, 10) / (radius * radius)};
    }
    case 3: {
      const double size = dice.by_exponent(needs_size ? 0.5 : 1e-2, 1e3);
      const Vec3d u = normalize(cross(place, Vec3d{0.3, 1, 0.1}));
      // It faces the object, roughly.
      const Vec3d v = normalize(cross(u, place));
      what += fmt::format(" panel {:.2g}", size);
      return PanelLight{place, u * size, v * (-size * dice.by_exponent(0.1, 10)),
                        dice.by_exponent(0.1, 10)};
    }
    case 4: {
      SunSkyLight sky = paper_sun_sky(dice.uniform(0, 6));
      sky.sun_elevation = dice.uniform(0.05, 1.5);
      sky.sun_angular_radius = dice.by_exponent(least_angle, 0.5);
      what += " sun_sky";
      return sky;
    }
    case 5: {
      EnvironmentMapLight map;
      map.width = 8;
      map.height = 4;
      for (int i = 0; i < 3 * map.width * map.height; ++i) {
        map.rgb.push_back(static_cast<float>(dice.once_in(4) ? 0 : dice.by_exponent(1e-3, 10)));
      }
      map.rotate_y = dice.uniform(0, 6);
      what += " map";
      return map;
    }
    case 6: what += " point"; return PointLight{place, 1e-6 * distance * distance};
    default:
      what += " spot";
      return SpotLight{place, {0, 0.5, 0}, 1e-6 * distance * distance, 0.3, dice.uniform(0.35, 1)};
  }
}

Boundary random_boundary(Dice& dice, int kind, std::string& what) {
  const auto index = static_cast<float>(dice.uniform(kind == 2 ? 1.1 : 1, 2.5));
  if (kind == 0) return IndexMatched{};
  if (kind == 1) {
    what += fmt::format(" smooth {:.3g}", index);
    return Dielectric{index};
  }
  const auto roughness = static_cast<float>(dice.by_exponent(0.03, 1));
  what += fmt::format(" rough {:.3g} {:.2g}", index, roughness);
  return RoughDielectric{index, roughness};
}

Material random_material(Dice& dice, double size) {
  const double albedo = dice.once_in(8) ? 0 : 1 - dice.by_exponent(3e-3, 1);
  return {dice.by_exponent(0.1, 60) / size, std::max(0.0, albedo), dice.uniform(-0.9, 0.95)};
}

const char* const kShapes[] = {"cube", "sphere", "mug", "twist", "knot", "smooth_star"};

}  // namespace

RandomScene random_scene(uint64_t number) {
  Dice dice(number);
  RandomScene result;
  SceneDescription& scene = result.description;
  const std::string shape = kShapes[dice.below(std::size(kShapes))];
  result.what = shape;
  scene.object = make_shape(shape);
  const double flat = dice.once_in(3) ? dice.by_exponent(0.03, 1) : 1;
  if (flat < 1) {
    result.what += fmt::format(" flat {:.2g}", flat);
    move(scene.object, [&](Vec3d& v) { v.y *= flat; });
  }
  const int kind = dice.below(3);
  scene.boundary = random_boundary(dice, kind, result.what);
  if (kind != 0 && dice.once_in(2)) scene.smooth_angle = 1;
  if (kind != 0 && dice.once_in(4)) {
    OtherObject other{make_shape("cube")};
    move(other.mesh, [&](Vec3d& v) { v = v * 0.6 + Vec3d{1.2, 0.1, 0.3}; });
    other.material = random_material(dice, 1);
    other.boundary = random_boundary(dice, kind, result.what);
    result.what += " beside another";
    scene.other_objects.push_back(std::move(other));
  }
  if (dice.once_in(2)) {
    DiffuseSurface ground(horizontal_square(0, static_cast<float>(dice.by_exponent(1, 50))),
                          static_cast<float>(dice.uniform(0, 1)));
    if (dice.once_in(2)) {
      result.what += " on a board";
      Checkerboard board;
      board.corner = {0.1, 0, 0.2};
      board.edge_u = {dice.by_exponent(0.05, 5), 0, 0.1};
      board.edge_v = {0, 0, dice.by_exponent(0.05, 5)};
      ground.reflectance = board;
    } else {
      result.what += " on a ground";
    }
    scene.surfaces.push_back(std::move(ground));
  }
  if (dice.once_in(4)) {
    result.what += " beside a ball";
    Mesh ball = sphere_of_triangles();
    move(ball, [](Vec3d& v) { v = v * 0.3 + Vec3d{-1, 0.4, 0.2}; });
    DiffuseSurface surface(std::move(ball), static_cast<float>(dice.uniform(0, 1)));
    if (dice.once_in(2)) surface.smooth_angle = 1;
    scene.surfaces.push_back(std::move(surface));
  }
  const int lights = 1 + dice.below(3);
  const bool needs_size = kind == 1;
  for (int i = 0; i < lights; ++i) {
    scene.lights.push_back(random_light(dice, needs_size, result.what));
  }
  const Bounds box = bounds(scene.object);
  const Vec3d middle{0, static_cast<double>(box.max.y) / 2, 0};
  const double distance = dice.by_exponent(3, 100);
  scene.camera.origin = middle + dice.direction(0.02) * distance;
  scene.camera.target = middle;
  if (std::abs(scene.camera.origin.y - middle.y) > 0.99 * distance) scene.camera.up = {0, 0, 1};
  scene.camera.fov = 2 * std::atan(0.6 / distance);
  scene.film = {4, 4, Channel::kLuminance};

  result.request.material = random_material(dice, std::min(1.0, 2 * flat));
  result.request.derivatives = medium_parameters();
  if (dice.once_in(5)) {
    result.what += " two_term";
    TwoTerm phase;
    phase.g_1 = static_cast<float>(dice.uniform(-0.9, 0.9));
    phase.g_2 = static_cast<float>(dice.uniform(-0.9, 0.9));
    phase.weight = static_cast<float>(dice.uniform(0, 1));
    result.request.phase = phase;
    result.request.derivatives.pop_back();
  }
  for (const uint32_t times : {0U, 1U}) {
    result.request.derivatives.push_back({Parameter::kScattered, times});
  }
  result.request.material.albedo = std::max(result.request.material.albedo, 1e-3);
  const Material& m = result.request.material;
  result.what += fmt::format(" sigma_t {:.3g} albedo {:.4g} g {:.2g}", m.sigma_t, m.albedo, m.g);
  return scaled(std::move(result), dice.by_exponent(1e-3, 1e3));
}

RandomScene scaled(RandomScene scene, double factor) {
  const auto scale = [&](Vec3d& v) { v = v * factor; };
  move(scene.description, scale, scale);
  for (LightDescription& light : scene.description.lights) {
    if (auto* sphere = std::get_if<SphereLight>(&light)) sphere->radius *= factor;
    if (std::holds_alternative<PointLight>(light) || std::holds_alternative<SpotLight>(light)) {
      brightness(light, factor * factor);
    }
  }
  scene.request.material.sigma_t /= factor;
  for (OtherObject& other : scene.description.other_objects) other.material.sigma_t /= factor;
  return scene;
}

RandomScene turned(RandomScene scene, double angle) {
  const auto turn = [&](Vec3d& v) { v = about_y(v, angle); };
  move(scene.description, turn, turn);
  turn(scene.description.camera.up);
  for (LightDescription& light : scene.description.lights) {
    if (auto* sun = std::get_if<DirectionalLight>(&light)) turn(sun->direction);
    if (auto* sky = std::get_if<SunSkyLight>(&light)) sky->sun_azimuth -= angle;
    if (auto* map = std::get_if<EnvironmentMapLight>(&light)) map->rotate_y += angle;
  }
  return scene;
}

RandomScene with_cut_triangles(RandomScene scene) {
  if (scene.description.smooth_angle == 0) cut(scene.description.object);
  for (OtherObject& other : scene.description.other_objects) cut(other.mesh);
  for (DiffuseSurface& surface : scene.description.surfaces) {
    if (surface.smooth_angle == 0) cut(surface.mesh);
  }
  return scene;
}

RandomScene with_split_lights(RandomScene scene) {
  std::vector<LightDescription>& lights = scene.description.lights;
  for (LightDescription& light : lights) brightness(light, 0.5);
  const std::vector<LightDescription> halves = lights;
  for (const LightDescription& half : halves) {
    // A lamp hides what is behind it, its other half too.
    const bool is_lamp =
        std::holds_alternative<SphereLight>(half) || std::holds_alternative<PanelLight>(half);
    if (is_lamp) {
      brightness(lights[static_cast<size_t>(&half - halves.data())], 2);
    } else {
      lights.push_back(half);
    }
  }
  return scene;
}

RandomScene lit_by(RandomScene scene, size_t number) {
  std::vector<LightDescription>& lights = scene.description.lights;
  for (size_t i = 0; i < lights.size(); ++i) {
    if (i != number) brightness(lights[i], 0);
  }
  return scene;
}

RandomScene in_a_furnace(RandomScene scene) {
  scene.description.lights = {ConstantLight{1}};
  scene.request.material.albedo = 1;
  for (OtherObject& other : scene.description.other_objects) other.material.albedo = 1;
  for (DiffuseSurface& surface : scene.description.surfaces) {
    surface.reflectance = UniformReflectance{1};
  }
  return scene;
}

}  // namespace itn::testing
