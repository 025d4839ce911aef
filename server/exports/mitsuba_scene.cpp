#include "server/exports/mitsuba_scene.h"

#include <fmt/format.h>

#include <pugixml.hpp>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>
#include <variant>

#include "common/angle.h"
#include "common/error.h"
#include "server/exports/air.h"
#include "server/exports/panorama.h"
#include "server/scene_compiler/field_reader.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/geometry/corner_normals.h"
#include "server/tracer/lights/lamp.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/scene/scene.h"

namespace itn {
namespace {

using tracer::Channel;
using tracer::Rgb;

// In as few digits as tell single-precision numbers apart, which Mitsuba's are.
std::string exact(double value) {
  return fmt::format("{}", static_cast<float>(value));
}

using Node = pugi::xml_node;

// Adds a part of the scene to another one.
Node plugin(Node to, const char* tag, const char* type, const char* name = nullptr) {
  Node node = to.append_child(tag);
  node.append_attribute("type") = type;
  if (name != nullptr) node.append_attribute("name") = name;
  return node;
}
// Each of these adds a property.
Node property(Node to, const char* tag, const char* name) {
  Node node = to.append_child(tag);
  node.append_attribute("name") = name;
  return node;
}
void text(Node to, const char* tag, const char* name, const std::string& value) {
  property(to, tag, name).append_attribute("value") = value.c_str();
}
void number(Node to, const char* name, double value) {
  text(to, "float", name, exact(value));
}
std::string triple(double a, double b, double c) {
  return fmt::format("{}, {}, {}", exact(a), exact(b), exact(c));
}
void colour(Node to, const char* name, const Rgb& rgb) {
  const auto& [red, green, blue] = rgb;
  if (red == green && red == blue) {
    number(to, name, red);
  } else {
    text(to, "rgb", name, triple(red, green, blue));
  }
}
void place(Node to, const char* tag, const char* name, Vec3d v) {
  Node node = property(to, tag, name);
  node.append_attribute("x") = exact(v.x).c_str();
  node.append_attribute("y") = exact(v.y).c_str();
  node.append_attribute("z") = exact(v.z).c_str();
}
void look_at(Node to, Vec3d origin, Vec3d target, Vec3d up) {
  Node node = property(to, "transform", "to_world").append_child("lookat");
  node.append_attribute("origin") = triple(origin.x, origin.y, origin.z).c_str();
  node.append_attribute("target") = triple(target.x, target.y, target.z).c_str();
  node.append_attribute("up") = triple(up.x, up.y, up.z).c_str();
}
// Of four rows, the last of which is that of every one.
void matrix(Node to, const char* name, const std::array<std::array<double, 4>, 3>& rows) {
  std::string all;
  for (const auto& [a, b, c, d] : rows) all += triple(a, b, c) + ", " + exact(d) + ", ";
  property(to, "transform", name).append_child("matrix").append_attribute("value") =
      (all + "0, 0, 0, 1").c_str();
}

// ---- The scene -------------------------------------------------------------------------------

class Writer {
 public:
  Writer(const v1::Scene& scene, std::span<const std::vector<Material>> media,
         const std::optional<v1::PhaseFunction>& phase, std::string stem)
      : proto_(scene), scene_(build_scene(scene, {})), stem_(std::move(stem)) {
    const tracer::Scene check(scene_);
    move_to_origin();
    leave_air();
    root_ = document_.append_child("scene");
    root_.append_attribute("version") = "3.0.0";
    root_.append_child(pugi::node_comment)
        .set_value((" A scene of itn. Lengths are in mm." + moved_ + " ").c_str());
    add_integrator(media);
    add_camera();
    std::optional<tracer::PhaseFunction> of_object;
    if (phase) of_object = read_kind<tracer::PhaseFunction>("phase", *phase, "kind");
    add_object("object", posed_object(), normals_of_object(), scene_.boundary, media[0], of_object);
    for (size_t i = 0; i < scene_.other_objects.size(); ++i) {
      const tracer::OtherObject& other = scene_.other_objects[i];
      add_object(fmt::format("other_object_{}", i), other.mesh,
                 smooth(other.mesh, other.smooth_angle), other.boundary, media[i + 1], {});
    }
    for (size_t i = 0; i < scene_.surfaces.size(); ++i) add_surface(i);
    add_lights();
  }

  MitsubaFiles take() {
    std::ostringstream xml;
    document_.save(xml, "  ");
    files_.xml = xml.str();
    return std::move(files_);
  }

 private:
  void leave(const std::string& note) { files_.not_carried_over.push_back(note); }
  std::string name_of(const std::string& part) const { return fmt::format("{}_{}", stem_, part); }

  // ---- Place ----

  // Mitsuba's rays start the farther off surfaces, the farther these are from the origin.
  void move_to_origin() {
    const Bounds box = bounds(posed_object());
    const Vec3d middle = middle_of(box);
    if (length(middle) <= longest_side(box)) return;
    const auto move = [&](Vec3d& place) { place = place - middle; };
    const auto move_mesh = [&](Mesh& mesh) {
      for (Vec3f& v : mesh.vertices) v = static_cast<Vec3f>(static_cast<Vec3d>(v) - middle);
    };
    move(scene_.pose.translation);
    move(scene_.camera.origin);
    move(scene_.camera.target);
    for (tracer::OtherObject& other : scene_.other_objects) move_mesh(other.mesh);
    for (tracer::DiffuseSurface& surface : scene_.surfaces) {
      move_mesh(surface.mesh);
      std::visit(
          [&](auto& kind) {
            if constexpr (requires { kind.corner; }) move(kind.corner);
          },
          surface.reflectance);
    }
    for (tracer::LightDescription& light : scene_.lights) {
      std::visit(
          [&](auto& kind) {
            if constexpr (requires { kind.center; }) move(kind.center);
            if constexpr (requires { kind.position; }) move(kind.position);
            if constexpr (requires { kind.target; }) move(kind.target);
          },
          light);
    }
    moved_ = fmt::format(" What was at {} is the origin.", triple(middle.x, middle.y, middle.z));
  }

  // ---- Air ----

  using Corners = std::array<Vec3d, 4>;

  // Rectangles are moved; of all else that may touch, it is said.
  void leave_air() {
    std::vector<Mesh> objects{posed_object()};
    for (const tracer::OtherObject& other : scene_.other_objects) objects.push_back(other.mesh);
    for (size_t i = 0; i < scene_.surfaces.size(); ++i) {
      Mesh& mesh = scene_.surfaces[i].mesh;
      const std::string name = fmt::format("surface_{}", i);
      if (is_rectangle(i)) {
        Corners corners;
        std::ranges::transform(mesh.vertices, corners.begin(),
                               [](Vec3f v) { return static_cast<Vec3d>(v); });
        const Vec3d away = away_from(name, objects, corners);
        for (Vec3f& v : mesh.vertices) v = v + static_cast<Vec3f>(away);
      } else if (std::ranges::any_of(objects, [&](auto& o) { return may_touch(o, mesh); })) {
        leave_dark(name);
      }
    }
    for (size_t i = 0; i < scene_.lights.size(); ++i) {
      auto* const panel = std::get_if<tracer::PanelLight>(&scene_.lights[i]);
      if (panel == nullptr) continue;
      panel->center =
          panel->center + away_from(fmt::format("lights[{}]", i), objects, corners_of(*panel));
    }
    for (size_t i = 1; i < objects.size(); ++i) {
      const auto before = std::span(objects).first(i);
      if (std::ranges::any_of(before, [&](auto& o) { return may_touch(o, objects[i]); })) {
        leave_dark(fmt::format("other_objects[{}]", i - 1));
      }
    }
  }
  void leave_dark(const std::string& name) {
    leave(name + ": where an object touches it, Mitsuba loses light; it needs a little air there");
  }
  Vec3d away_from(const std::string& name, std::span<const Mesh> objects, const Corners& corners) {
    const Contact contact = contact_of(corners, objects);
    if (const double moved = length(contact.away); moved > 0) {
      leave(
          fmt::format("{}: an object touches it; it is moved {:.2g} mm away, as Mitsuba needs a "
                      "little air there",
                      name, moved));
    } else if (contact.touches) {
      leave_dark(name);
    }
    return contact.away;
  }
  static Corners corners_of(const tracer::PanelLight& panel) {
    const auto& [center, u, v, radiance] = panel;
    return {center - u - v, center + u - v, center + u + v, center - u + v};
  }

  bool film_is_in_colour() const { return scene_.film.channel == Channel::kRgb; }
  // As the film sees it.
  Rgb seen(const Rgb& rgb) const {
    if (film_is_in_colour()) return rgb;
    const double gray = select(rgb, scene_.film.channel);
    return {gray, gray, gray};
  }
  void add_seen(Rgb rgb, double scale, std::vector<float>& to) const {
    for (double& one : rgb) one *= scale;
    for (const double one : seen(rgb)) to.push_back(static_cast<float>(one));
  }

  // ---- Camera and film ----

  // Paths of all lengths; by spectral multiple importance sampling where channels differ.
  void add_integrator(std::span<const std::vector<Material>> media) {
    const bool colours = std::ranges::any_of(media, [](const auto& m) { return m.size() > 1; });
    const Node integrator = plugin(root_, "integrator", colours ? "volpathmis" : "volpath");
    text(integrator, "integer", "max_depth", "-1");
    text(integrator, "integer", "rr_depth", "64");
  }

  void add_camera() {
    const tracer::CameraDescription& camera = scene_.camera;
    const tracer::FilmDescription& film = scene_.film;
    if (camera.k_1 != 0 || camera.k_2 != 0) leave("camera: its lens distorts; Mitsuba's does not");
    // What the film shows is an image of its own, whose principal point is elsewhere.
    const double across = camera.right - camera.left, down = camera.bottom - camera.top;
    const Node sensor = plugin(root_, "sensor", "perspective");
    number(sensor, "fov", 2 * std::atan(std::tan(camera.fov / 2) * across) / kRadiansPerDegree);
    text(sensor, "string", "fov_axis", "x");
    number(sensor, "principal_point_offset_x", 0.5 - (camera.principal_x - camera.left) / across);
    number(sensor, "principal_point_offset_y", 0.5 - (camera.principal_y - camera.top) / down);
    // What is nearer, or farther away, is not seen; unless they are given, 0.01 and 10^4.
    const double distance = length(camera.target - camera.origin);
    if (distance < 10) number(sensor, "near_clip", 1e-3 * distance);
    if (farthest() > 1e4) number(sensor, "far_clip", 2 * farthest());
    look_at(sensor, camera.origin, camera.target, camera.up);
    text(plugin(sensor, "sampler", "independent"), "integer", "sample_count", "64");
    const Node to = plugin(sensor, "film", "hdrfilm");
    text(to, "integer", "width", std::to_string(film.width));
    text(to, "integer", "height", std::to_string(film.height));
    text(to, "string", "pixel_format", film_is_in_colour() ? "rgb" : "luminance");
    text(to, "string", "component_format", "float32");
    plugin(to, "rfilter", "box");
  }

  // The distance from the camera of what is the farthest away of all that has one, in mm.
  double farthest() const {
    double most = 0;
    const auto look = [&](const Mesh& mesh, const Pose& pose) {
      for (const Vec3f v : mesh.vertices) {
        most = std::max(most, length(pose.to_scene(static_cast<Vec3d>(v)) - scene_.camera.origin));
      }
    };
    look(scene_.object, scene_.pose);
    for (const tracer::OtherObject& other : scene_.other_objects) look(other.mesh, {});
    for (const tracer::DiffuseSurface& surface : scene_.surfaces) look(surface.mesh, {});
    const auto look_at = [&](Vec3d place, double radius) {
      most = std::max(most, length(place - scene_.camera.origin) + radius);
    };
    for (const tracer::LightDescription& light : scene_.lights) {
      if (const auto* sphere = std::get_if<tracer::SphereLight>(&light)) {
        look_at(sphere->center, sphere->radius);
      } else if (const auto* panel = std::get_if<tracer::PanelLight>(&light)) {
        for (const Vec3d corner : corners_of(*panel)) look_at(corner, 0);
      }
    }
    return most;
  }

  // ---- Shapes ----

  using Normals = std::vector<std::array<Vec3f, 3>>;  // see MitsubaFiles::Shape

  static Normals smooth(const Mesh& mesh, double angle) {
    if (angle == 0) return {};
    return tracer::CornerNormals(mesh, {{0, angle}}).by_triangle();
  }
  Mesh posed_object() const {
    Mesh mesh = scene_.object;
    for (Vec3f& v : mesh.vertices) {
      v = static_cast<Vec3f>(scene_.pose.to_scene(static_cast<Vec3d>(v)));
    }
    return mesh;
  }
  Normals normals_of_object() const {
    Normals normals = scene_.corner_normals.empty() ? smooth(scene_.object, scene_.smooth_angle)
                                                    : scene_.corner_normals;
    for (auto& corners : normals) {
      for (Vec3f& n : corners) {
        n = static_cast<Vec3f>(scene_.pose.rotation(static_cast<Vec3d>(n)));
      }
    }
    return normals;
  }

  Node add_mesh(const std::string& part, const Mesh& mesh, const Normals& normals) {
    const std::string file = name_of(part) + ".ply";
    const Node shape = plugin(root_, "shape", "ply");
    text(shape, "string", "filename", file);
    text(shape, "boolean", "face_normals", normals.empty() ? "true" : "false");
    files_.shapes.push_back({file, mesh, normals});
    return shape;
  }

  void add_object(const std::string& part, const Mesh& mesh, const Normals& normals,
                  const tracer::Boundary& boundary, const std::vector<Material>& materials,
                  const std::optional<tracer::PhaseFunction>& phase) {
    const Node shape = add_mesh(part, mesh, normals);
    std::visit([&](const auto& kind) { add_boundary(shape, part, kind); }, boundary);
    say_how_dense(part, mesh, materials);
    const Node medium = plugin(shape, "medium", "homogeneous", "interior");
    add_coefficients(medium, materials);
    if (phase) {
      std::visit([&](const auto& kind) { add_phase(medium, part, kind); }, *phase);
    } else {
      const double g = materials[0].g;
      const auto differs = [&](const Material& m) { return m.g != g; };
      if (std::ranges::any_of(materials, differs)) {
        leave(part + ": each channel has a g of its own; that of red is that of all in Mitsuba");
      }
      add_lobe(medium, g);
    }
  }

  // Of bodies at several places and of several sigma_t, what is lost was a third of the part of the
  // mean free path.
  void say_how_dense(const std::string& part, const Mesh& mesh,
                     const std::vector<Material>& materials) {
    const double start = start_of_rays(mesh);
    double densest = 0;
    for (const Material& material : materials) densest = std::max(densest, material.sigma_t);
    constexpr double kMuch = 0.03;
    if (densest * start <= kMuch) return;
    leave(
        fmt::format("{}: Mitsuba's rays start {:.2g} mm off surfaces, {:.2g} of its mean free "
                    "path: it is darker by about a third of that",
                    part, start, densest * start));
  }

  static void add_boundary(Node to, const std::string& /*part*/, const tracer::IndexMatched&) {
    plugin(to, "bsdf", "null");
  }
  static void add_boundary(Node to, const std::string& /*part*/, const tracer::Dielectric& smooth) {
    add_indices(plugin(to, "bsdf", "dielectric"), smooth.index);
  }
  void add_boundary(Node to, const std::string& part, const tracer::RoughDielectric& rough) {
    if (!rough.single_scattering) {
      leave(
          part +
          ": light that meets more than one microfacet is lost in Mitsuba, which makes it darker, "
          "by a third at a roughness of 0.2; `single_scattering: true` makes it so here, too");
    }
    const Node bsdf = plugin(to, "bsdf", "roughdielectric");
    text(bsdf, "string", "distribution", "ggx");
    number(bsdf, "alpha", rough.roughness);
    add_indices(bsdf, rough.index);
  }
  // No message has another one.
  static void add_boundary(Node to, const std::string& /*part*/, const tracer::PartialMirror&) {
    plugin(to, "bsdf", "null");
  }
  static void add_indices(Node to, double index) {
    number(to, "int_ior", index);
    number(to, "ext_ior", 1);
  }

  // Colours are in [0, 1] there, and are multiplied by the scale.
  static void add_coefficients(Node medium, const std::vector<Material>& materials) {
    Rgb sigma_t{}, albedo{};
    for (size_t c = 0; c < 3; ++c) {
      const Material& material = materials[std::min(c, materials.size() - 1)];
      sigma_t[c] = material.sigma_t;
      albedo[c] = material.albedo;
    }
    if (materials.size() == 1) {
      number(medium, "sigma_t", sigma_t[0]);
    } else {
      const double largest = std::ranges::max(sigma_t);
      for (double& sigma : sigma_t) sigma /= largest;
      colour(medium, "sigma_t", sigma_t);
      number(medium, "scale", largest);
    }
    colour(medium, "albedo", albedo);
  }

  static void add_lobe(Node to, double g) { number(plugin(to, "phase", "hg"), "g", g); }
  static void add_phase(Node to, const std::string& /*part*/, const tracer::TwoTerm& two) {
    const Node blend = plugin(to, "phase", "blendphase");
    number(blend, "weight", 1 - double{two.weight});  // of the second
    add_lobe(blend, two.g_1);
    add_lobe(blend, two.g_2);
  }
  void add_phase(Node to, const std::string& part, const auto& phase) {
    leave(part + ": its phase function is hg of the same mean cosine in Mitsuba");
    add_lobe(to, phase.mean_cosine());
  }

  static Vec3d vector_of(const v1::Vec3& v) { return {v.x(), v.y(), v.z()}; }
  // Mitsuba's rectangles have right angles.
  static bool is_right_angled(Vec3d u, Vec3d v) {
    return std::abs(dot(u, v)) <= 1e-6 * length(u) * length(v);
  }
  Node add_rectangle(Vec3d center, Vec3d half_u, Vec3d half_v) {
    const Node shape = plugin(root_, "shape", "rectangle");
    const Vec3d n = normalize(cross(half_u, half_v));  // of its front
    matrix(shape, "to_world",
           {{{half_u.x, half_v.x, n.x, center.x},
             {half_u.y, half_v.y, n.y, center.y},
             {half_u.z, half_v.z, n.z, center.z}}});
    return shape;
  }

  // Where the texture coordinates of a rectangle are 0, and its sides along them.
  struct Sides {
    Vec3d corner, u, v;
  };

  bool is_rectangle(size_t surface) const {
    return proto_.surfaces(static_cast<int>(surface)).has_rectangle();
  }
  void add_surface(size_t i) {
    const tracer::DiffuseSurface& surface = scene_.surfaces[i];
    const std::string part = fmt::format("surface_{}", i);
    if (is_rectangle(i)) {
      // Its corners, in turn, which are rounded where they are far away; its sides are not.
      const auto corner = [&](size_t k) { return static_cast<Vec3d>(surface.mesh.vertices[k]); };
      const Sides sides{corner(0), corner(1) - corner(0), corner(3) - corner(0)};
      const v1::Rectangle& proto = proto_.surfaces(static_cast<int>(i)).rectangle();
      if (is_right_angled(vector_of(proto.half_u()), vector_of(proto.half_v()))) {
        const Vec3d center = (corner(0) + corner(2)) * 0.5;
        add_reflectance(add_rectangle(center, sides.u * 0.5, sides.v * 0.5), part,
                        surface.reflectance, &sides);
        return;
      }
    }
    add_reflectance(add_mesh(part, surface.mesh, smooth(surface.mesh, surface.smooth_angle)), part,
                    surface.reflectance, nullptr);
  }

  // `sides`: of a rectangle.
  void add_reflectance(Node shape, const std::string& part, const tracer::Reflectance& reflectance,
                       const Sides* sides) {
    const Node bsdf = plugin(plugin(shape, "bsdf", "twosided"), "bsdf", "diffuse");
    if (const auto* uniform = std::get_if<tracer::UniformReflectance>(&reflectance)) {
      number(bsdf, "reflectance", uniform->value);
    } else if (const auto* rgb = std::get_if<tracer::ColorReflectance>(&reflectance)) {
      colour(bsdf, "reflectance", seen({rgb->red, rgb->green, rgb->blue}));
    } else if (sides == nullptr) {
      leave(part +
            ": its pattern; one on a rectangle of right angles has a counterpart. Its reflectance "
            "is 0.5 in Mitsuba");
      number(bsdf, "reflectance", 0.5);
    } else if (const auto* board = std::get_if<tracer::Checkerboard>(&reflectance)) {
      const Node texture = plugin(bsdf, "texture", "checkerboard", "reflectance");
      number(texture, "color0", board->even);
      number(texture, "color1", board->odd);
      // Its coordinates go over two squares.
      add_to_uv(texture, *sides, *board, {0.5, 0}, {0.5, 0});
    } else {
      const auto& image = std::get<tracer::ImageReflectance>(reflectance);
      const Node texture = plugin(bsdf, "texture", "bitmap", "reflectance");
      text(texture, "string", "filename",
           add_picture(part, image.width, image.height, image.scale, *image.values));
      // Its upper side is where the second coordinate is 0.
      add_to_uv(texture, *sides, image, {1, 0}, {-1, 1});
    }
  }

  struct Line {
    double slope, start;
  };
  // From the texture coordinates of a rectangle to those that `u` and `v` make of the parts of the
  // edges of a pattern.
  static void add_to_uv(Node texture, const Sides& sides, const auto& pattern, Line u, Line v) {
    const tracer::PlaneCoordinates plane({}, "", pattern.corner, pattern.edge_u, pattern.edge_v);
    const Vec3d from_corner = sides.corner - pattern.corner;
    const auto row = [&](Vec3d per, Line line) -> std::array<double, 4> {
      return {line.slope * dot(per, sides.u), line.slope * dot(per, sides.v), 0,
              line.start + line.slope * dot(per, from_corner)};
    };
    matrix(texture, "to_uv", {row(plane.per_u, u), row(plane.per_v, v), {0, 0, 1, 0}});
  }

  // Returns the name of its file. `rgb`: to be scaled.
  std::string add_picture(const std::string& part, int width, int height, double scale,
                          const std::vector<float>& rgb) {
    const std::string file = name_of(part) + ".exr";
    MitsubaFiles::Picture picture{file, width, height, {}, part == kPanorama};
    for (size_t i = 0; i < rgb.size(); i += 3) {
      add_seen({rgb[i], rgb[i + 1], rgb[i + 2]}, scale, picture.rgb);
    }
    files_.pictures.push_back(std::move(picture));
    return file;
  }

  // ---- Lights ----

  // Of the scene's light of this number, which has this luminance.
  Rgb coloured(size_t light, double luminance_of_light) const {
    Rgb rgb = scene_.light_colours[light];
    const double scale = luminance_of_light / luminance(rgb);
    for (double& one : rgb) one *= scale;
    return seen(rgb);
  }

  void add_lights() {
    std::vector<size_t> far;
    for (size_t i = 0; i < scene_.lights.size(); ++i) {
      if (is_panoramic(scene_.lights[i])) {
        far.push_back(i);
      } else {
        std::visit([&](const auto& light) { add_light(i, light); }, scene_.lights[i]);
      }
    }
    if (far.empty()) return;
    const tracer::LightDescription& first = scene_.lights[far[0]];
    const auto* const constant = std::get_if<tracer::ConstantLight>(&first);
    if (constant != nullptr && far.size() == 1) {
      colour(plugin(root_, "emitter", "constant"), "radiance",
             coloured(far[0], constant->radiance));
    } else {
      add_panorama(far);
    }
  }

  static constexpr const char* kPanorama = "panorama";
  void add_panorama(const std::vector<size_t>& far) {
    double degrees = 0;
    std::string file;
    const auto* const map = std::get_if<tracer::EnvironmentMapLight>(&scene_.lights[far[0]]);
    if (map != nullptr && far.size() == 1) {
      degrees = map->rotate_y / kRadiansPerDegree;
      const Panorama panorama = panorama_of(*map);
      file = add_picture(kPanorama, panorama.width, panorama.height, map->scale, panorama.rgb);
    } else {
      std::vector<tracer::LightDescription> lights;
      std::vector<Rgb> colours;
      for (const size_t i : far) {
        lights.push_back(scene_.lights[i]);
        colours.push_back(scene_.light_colours[i]);
      }
      const Panorama panorama = panorama_of(lights, colours, scene_.film.channel);
      if (panorama.loses_detail) {
        leave(
            fmt::format("the panorama of lights that are far away has {} columns, fewer than a "
                        "map of theirs",
                        panorama.width));
      }
      file = add_picture(kPanorama, panorama.width, panorama.height, 1, panorama.rgb);
    }
    const Node emitter = plugin(root_, "emitter", "envmap");
    text(emitter, "string", "filename", file);
    Node rotate = property(emitter, "transform", "to_world").append_child("rotate");
    rotate.append_attribute("y") = "1";
    rotate.append_attribute("angle") = exact(degrees).c_str();
  }

  void add_light(size_t i, const tracer::DirectionalLight& light) {
    const Node emitter = plugin(root_, "emitter", "directional");
    place(emitter, "vector", "direction", -normalize(light.direction));
    colour(emitter, "irradiance", coloured(i, light.irradiance));
  }
  void add_light(size_t i, const tracer::PointLight& light) {
    const Node emitter = plugin(root_, "emitter", "point");
    place(emitter, "point", "position", light.position);
    colour(emitter, "intensity", coloured(i, light.intensity * tracer::kSquareMmPerSquareM));
  }
  void add_light(size_t i, const tracer::SpotLight& light) {
    leave(fmt::format("lights[{}]: how it fades between its two angles differs", i));
    const Vec3d along = light.target - light.position;
    const bool is_steep = std::abs(along.y) > 0.9 * length(along);
    const Node emitter = plugin(root_, "emitter", "spot");
    look_at(emitter, light.position, light.target, is_steep ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0});
    number(emitter, "beam_width", light.inner_angle / kRadiansPerDegree);
    number(emitter, "cutoff_angle", light.outer_angle / kRadiansPerDegree);
    colour(emitter, "intensity", coloured(i, light.intensity * tracer::kSquareMmPerSquareM));
  }
  void add_light(size_t i, const tracer::SphereLight& light) {
    const Node shape = plugin(root_, "shape", "sphere");
    place(shape, "point", "center", light.center);
    number(shape, "radius", light.radius);
    make_shine(shape, coloured(i, light.radiance));
  }
  void add_light(size_t i, const tracer::PanelLight& light) {
    const auto& [center, u, v, radiance] = light;
    if (is_right_angled(u, v)) {
      make_shine(add_rectangle(center, u, v), coloured(i, radiance));
      return;
    }
    Mesh mesh;
    for (const Vec3d corner : corners_of(light)) {
      mesh.vertices.push_back(static_cast<Vec3f>(corner));
    }
    mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    make_shine(add_mesh(fmt::format("light_{}", i), mesh, {}), coloured(i, radiance));
  }
  // They are in the panorama.
  static void add_light(size_t /*i*/, const tracer::SunSkyLight& /*light*/) {}
  static void add_light(size_t /*i*/, const tracer::EnvironmentMapLight& /*light*/) {}
  static void add_light(size_t /*i*/, const tracer::ConstantLight& /*light*/) {}

  // Lamps are black to other light.
  static void make_shine(Node shape, const Rgb& radiance) {
    number(plugin(shape, "bsdf", "diffuse"), "reflectance", 0);
    colour(plugin(shape, "emitter", "area"), "radiance", radiance);
  }

  const v1::Scene& proto_;
  tracer::SceneDescription scene_;
  const std::string stem_;
  std::string moved_;
  pugi::xml_document document_;
  Node root_;
  MitsubaFiles files_;
};

}  // namespace

MitsubaFiles to_mitsuba(const v1::Scene& scene, std::span<const std::vector<Material>> media,
                        const std::optional<v1::PhaseFunction>& phase, const std::string& stem) {
  for (const std::vector<Material>& materials : media) {
    for (const Material& material : materials) validate(material);
  }
  return Writer(scene, media, phase, stem).take();
}

}  // namespace itn
