#include "client/import/import_mitsuba.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <map>
#include <set>
#include <span>
#include <utility>

#include "client/import/mitsuba_xml.h"
#include "client/measured_media.h"
#include "common/angle.h"
#include "common/error.h"
#include "common/luminance.h"
#include "common/printable.h"
#include "common/render_limits.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

using Colour = std::array<double, 3>;
using Eigen::Affine3d;
using Eigen::Vector3d;

// Indices of refraction by Mitsuba's names, at 589 nm; after its documentation.
const std::map<std::string, double>& named_indices() {
  static const std::map<std::string, double> indices{
      {"vacuum", 1.0},      {"helium", 1.000036},        {"hydrogen", 1.000132},
      {"air", 1.000277},    {"carbon dioxide", 1.00045}, {"water", 1.3330},
      {"acetone", 1.36},    {"ethanol", 1.361},          {"carbon tetrachloride", 1.461},
      {"glycerol", 1.4729}, {"benzene", 1.501},          {"silicone oil", 1.52045},
      {"bromine", 1.661},   {"water ice", 1.31},         {"fused quartz", 1.458},
      {"pyrex", 1.470},     {"acrylic glass", 1.49},     {"polypropylene", 1.49},
      {"bk7", 1.5046},      {"sodium chloride", 1.544},  {"amber", 1.55},
      {"pet", 1.5750},      {"diamond", 2.419}};
  return indices;
}

// What Mitsuba has beside the scene: how to render it, which every program decides by itself.
bool is_about_rendering(const MitsubaPlugin& plugin) {
  static const std::set<std::string> tags{"integrator", "sampler", "rfilter"};
  return tags.contains(plugin.tag);
}

class Importer {
 public:
  Importer(const fs::path& path, const ImportOptions& options)
      : options_(options),
        folder_(path.parent_path()),
        file_(read_mitsuba(path, options.definitions)) {
    world_ = Eigen::Scaling(options.mm_per_scene_unit) * upright();
  }

  ImportedScene run() {
    const MitsubaPlugin& scene = *file_.scene;
    scene.used = true;
    for (const auto& [name, child] : scene.children) {
      if (child->tag == "shape") {
        child->used = true;
        add_shape(*child);
      } else if (child->tag == "emitter" || child->tag == "luminaire") {
        if (child->type == "area") continue;  // of shapes that refer to it
        child->used = true;
        add_emitter(*child);
      } else if (child->tag == "sensor" || child->tag == "camera") {
        if (result_.scene.has_camera()) {
          leave(*child, "there is a camera already");
        } else {
          add_camera(*child);
        }
      } else if (child->tag == "integrator") {
        read_integrator(*child);
      }
    }
    result_.in_colour = is_in_colour();
    if (!result_.scene.has_camera()) {
      throw invalid_input(scene.place + ": no <sensor>; a scene here needs a camera");
    }
    leave_backs();
    if (!result_.scene.has_object()) {
      leave(scene, "no shape has a medium in it; `object` of the scene file is to be written");
    }
    if (result_.scene.lights().empty()) {
      leave(scene, "nothing shines; `lights` of the scene file are to be written");
    }
    if (!upright().isApprox(Affine3d::Identity())) {
      leave(scene,
            "it was turned so that its sky stands over +y: coordinates are others than there");
    }
    if (!file_.has_version) leave(scene, "has no version; it was read as one of Mitsuba 3");
    leave_unused(scene);
    return std::move(result_);
  }

 private:
  void leave(const MitsubaPlugin& what, const std::string& why) {
    const std::string note = fmt::format("{}: {}", what.place, why);
    if (std::ranges::find(result_.not_carried_over, note) == result_.not_carried_over.end()) {
      result_.not_carried_over.push_back(note);
    }
  }

  bool is_in_colour() const {
    if (options_.channel != v1::Film::LUMINANCE) return false;
    if (result_.medium) {
      const auto& [red, green, blue] = *result_.medium;
      if (red != green || red != blue) return true;
    }
    const v1::Scene& scene = result_.scene;
    const auto has_image = [](const v1::Surface& s) { return s.has_color() || s.has_image(); };
    const auto has_colours = [](const v1::Object& o) { return o.material_size() == 3; };
    return !film_is_gray_ && (std::ranges::any_of(scene.lights(), &v1::Light::has_color) ||
                              std::ranges::any_of(scene.surfaces(), has_image) ||
                              std::ranges::any_of(scene.other_objects(), has_colours));
  }

  // Surfaces here reflect on both sides; in Mitsuba the camera may look at a black back.
  void leave_backs() {
    const v1::Vec3& origin = result_.scene.camera().origin();
    const Vector3d camera(origin.x(), origin.y(), origin.z());
    for (const auto& [bsdf, transform] : one_sided_) {
      const Vector3d normal =
          transform.linear().inverse().transpose() * Vector3d::UnitZ();  // of its front
      if (normal.dot(camera - transform.translation()) < 0) {
        leave(*bsdf, "its back, which the camera sees, reflects here; in Mitsuba it is black");
      }
    }
  }

  // With all that is in it.
  void leave_out(const MitsubaPlugin& what, const std::string& why) {
    leave(what, why);
    visited_.insert(&what);
  }

  // What of it shows in the image.
  void read_integrator(const MitsubaPlugin& integrator) {
    if (integrator.type == "direct") {
      leave(integrator, "direct light alone: paths of all lengths are followed here");
    } else if (integrator.type == "path") {
      leave(integrator, "it passes by all media; paths are followed into them here");
    }
    if (integrator.number("max_depth", -1) >= 0) {
      leave(integrator, "max_depth: paths of all lengths are followed here");
    }
    if (integrator.flag("hide_emitters", false)) {
      leave(integrator, "hide_emitters: lights that the camera looks into are seen here");
    }
    for (const auto& [name, nested] : integrator.children) {
      if (nested->tag == "integrator") read_integrator(*nested);
    }
  }

  // All that nobody read, of what was. What is at the top is there to be referred to.
  void leave_unused(const MitsubaPlugin& plugin, bool is_top = true) {
    if (is_about_rendering(plugin) || !visited_.insert(&plugin).second) return;
    for (const auto& [name, property] : plugin.properties) {
      if (!property.used) leave(plugin, printable(name) + " was not carried over");
    }
    for (const auto& [name, transform] : plugin.transforms) {
      if (!plugin.used_transforms.contains(name)) {
        leave(plugin, fmt::format("its transform \"{}\" was not carried over", printable(name)));
      }
    }
    for (const auto& [name, child] : plugin.children) {
      static const std::set<std::string> definitions{"bsdf", "medium", "texture", "phase"};
      if (child->used) {
        leave_unused(*child, false);
      } else if (!is_about_rendering(*child) && !(is_top && definitions.contains(child->tag))) {
        leave(*child, name.empty() ? "was not carried over"
                                   : fmt::format("({} of {}) was not carried over", printable(name),
                                                 plugin.place));
      }
    }
  }

  // The world turned so that skies stand over +y: Mitsuba 3's own stand over +z, others over +y, of
  // coordinates that a transform turns.
  Affine3d upright() const {
    for (const auto& [name, child] : file_.scene->children) {
      static const std::set<std::string> skies{"sky", "sun", "sunsky", "envmap"};
      if (child->tag != "emitter" || !skies.contains(child->type)) continue;
      const Vector3d zenith = child->transform("to_world").linear() * zenith_of(*child);
      return Affine3d(Eigen::Quaterniond::FromTwoVectors(zenith, Vector3d::UnitY()));
    }
    return Affine3d::Identity();
  }
  Vector3d zenith_of(const MitsubaPlugin& emitter) const {
    return file_.is_3 && emitter.type != "envmap" ? Vector3d::UnitZ() : Vector3d::UnitY();
  }

  // Whether a colour stays one: where no channel was asked for, and it is not gray.
  bool is_kept(const Colour& colour) const {
    return options_.channel == v1::Film::LUMINANCE &&
           (colour[0] != colour[1] || colour[1] != colour[2]);
  }
  float number_of(const Colour& colour) const {
    if (options_.channel == v1::Film::LUMINANCE) {
      return static_cast<float>(luminance(colour));
    }
    return static_cast<float>(colour[static_cast<size_t>(options_.channel - v1::Film::RED)]);
  }
  template <typename Message>
  static void set_color(const Colour& colour, Message& color) {
    color.set_red(static_cast<float>(colour[0]));
    color.set_green(static_cast<float>(colour[1]));
    color.set_blue(static_cast<float>(colour[2]));
  }

  Colour colour_of(const MitsubaPlugin& of, const std::string& property, double otherwise) {
    if (of.has_spectrum(property)) {
      leave(of, printable(property) + ": R, G and B of its spectrum were taken");
    }
    return of.colour(property, otherwise);
  }
  // A number for a colour that cannot be kept.
  float number_for(const MitsubaPlugin& of, const std::string& property, double otherwise) {
    const Colour colour = colour_of(of, property, otherwise);
    if (is_kept(colour)) {
      leave(of, "its colour: the luminance was taken; --channel takes R, G or B");
    }
    return number_of(colour);
  }
  // How bright a light is, which takes its colour.
  float brightness_of(const MitsubaPlugin& of, const std::string& property, v1::Light& light) {
    const Colour colour = colour_of(of, property, 1);
    if (is_kept(colour)) set_color(colour, *light.mutable_color());
    return number_of(colour);
  }

  static void set(v1::Vec3& to, const Vector3d& v) {
    to.set_x(static_cast<float>(v.x()));
    to.set_y(static_cast<float>(v.y()));
    to.set_z(static_cast<float>(v.z()));
  }
  // Takes the sides of Mitsuba's rectangle, which is [-1, 1] x [-1, 1]. Its normal goes with the
  // surface: a mirror image faces the way that its z axis points to, and not that of the cross
  // product of its sides.
  template <typename Rectangle>
  static void set_sides(Rectangle& to, const Affine3d& transform, bool flip = false) {
    const double side = (transform.linear().determinant() < 0) != flip ? -1 : 1;
    set(*to.mutable_center(), transform.translation());
    set(*to.mutable_half_u(), transform.linear().col(0));
    set(*to.mutable_half_v(), transform.linear().col(1) * side);
  }
  static bool flips(const MitsubaPlugin& shape) { return shape.flag("flip_normals", false); }
  Affine3d to_world(const MitsubaPlugin& plugin) const {
    return world_ * plugin.transform("to_world");
  }

  std::string path_of(const MitsubaPlugin& plugin) {
    const fs::path name = plugin.text("filename", "");
    if (name.empty()) throw invalid_input(plugin.place + ": no filename");
    const fs::path from =
        fs::absolute(options_.output_folder.empty() ? "." : options_.output_folder);
    return fs::absolute(folder_ / name)
        .lexically_normal()
        .lexically_proximate(from)
        .generic_string();
  }

  // Shapes.

  static double radius_of(const MitsubaPlugin& shape) {
    const double radius = shape.number("radius", 1);
    if (radius > 0) return radius;
    throw invalid_input(fmt::format("{}: radius is {}; it must be above 0", shape.place, radius));
  }

  // False if the shape has no counterpart.
  bool set_mesh(v1::Mesh& mesh, const MitsubaPlugin& shape) {
    Affine3d transform = to_world(shape);
    if (shape.type == "cube" || shape.type == "sphere") {
      // Ours are 1 mm wide, and stand on y = 0.
      mesh.set_builtin(shape.type);
      const Vector3d middle =
          shape.type == "sphere" ? shape.vector("center", Vector3d::Zero()) : Vector3d::Zero();
      transform = transform * Eigen::Translation3d(middle) * Eigen::Scaling(2 * radius_of(shape)) *
                  Eigen::Translation3d(0, -0.5, 0);
      if (shape.type == "sphere") leave(shape, "is a mesh of 20480 triangles here");
    } else if (shape.type == "ply" || shape.type == "obj" || shape.type == "stl") {
      mesh.set_path(path_of(shape));
    } else {
      return false;
    }
    if (!(std::abs(transform.linear().determinant()) > 0)) {
      throw invalid_input(shape.place + ": its to_world makes it flat");
    }
    v1::Matrix& matrix = *mesh.add_transforms()->mutable_matrix();
    for (Eigen::Index i = 0; i < 16; ++i) {
      matrix.add_m(static_cast<float>(transform.matrix()(i / 4, i % 4)));
    }
    return true;
  }

  // That which the plugins in `wrappers` stand around, if any.
  static const MitsubaPlugin* unwrapped_bsdf(const MitsubaPlugin& shape) {
    static const std::set<std::string> wrappers{"twosided", "mask", "bumpmap", "normalmap"};
    const MitsubaPlugin* bsdf = shape.child("bsdf");
    while (bsdf && wrappers.contains(bsdf->type)) bsdf = bsdf->child("bsdf");
    return bsdf;
  }

  void add_shape(const MitsubaPlugin& shape) {
    shape.flag("face_normals", false);
    if (const MitsubaPlugin* const around = shape.child("medium", "exterior")) {
      leave_out(*around, "is around objects; there is clear air here");
    }
    if (const MitsubaPlugin* const medium = shape.child("medium", "interior")) {
      if (is_inside_another(shape)) {
        leave_out(shape,
                  "is in another solid, and not there: solids inside of solids have no "
                  "counterpart");
        return;
      }
      const bool first = !result_.scene.has_object();
      add_object(shape, *medium,
                 first ? *result_.scene.mutable_object() : *result_.scene.add_other_objects());
    } else if (const MitsubaPlugin* const emitter = shape.child("emitter")) {
      add_lamp(shape, *emitter);
    } else {
      add_surface(shape);
    }
  }

  void add_object(const MitsubaPlugin& shape, const MitsubaPlugin& medium, v1::Object& object) {
    if (!set_mesh(*object.mutable_mesh(), shape)) {
      throw invalid_input(
          fmt::format("{}: the medium is in a shape that has no counterpart; ply, obj, stl, cube "
                      "and sphere have",
                      shape.place));
    }
    if (object.mesh().has_path()) object.mutable_mesh()->set_repair(true);
    if (flips(shape)) leave(shape, "flip_normals: the medium is inside here");
    set_boundary(object, shape);
    set_medium(object, medium);
    make_of_one_kind(shape, object);
  }

  // Where there are several objects, their boundaries are of one kind.
  void make_of_one_kind(const MitsubaPlugin& shape, v1::Object& object) {
    v1::Object& first = *result_.scene.mutable_object();
    if (&object == &first) return;
    for (v1::Object* each : {&first, &object}) {
      const bool none = each->refraction_case() == v1::Object::REFRACTION_NOT_SET;
      if (none) each->mutable_dielectric()->set_index(1);  // lets light pass as it is
    }
    if (object.refraction_case() == first.refraction_case()) return;
    leave(shape,
          "is smooth where the first object is rough, or the other way round; the objects of a "
          "scene here are of one kind");
    result_.scene.mutable_other_objects()->RemoveLast();
  }

  double index_of(const MitsubaPlugin& bsdf, const std::string& property,
                  const std::string& otherwise) const {
    if (!bsdf.has(property)) return named_indices().at(otherwise);
    const std::string text = bsdf.text(property, "");
    if (const auto named = named_indices().find(text); named != named_indices().end()) {
      return named->second;
    }
    const bool is_name = !text.empty() && std::isalpha(static_cast<unsigned char>(text[0])) != 0;
    if (!is_name) return bsdf.number(property, 1);
    std::vector<std::string> names;
    for (const auto& [name, index] : named_indices()) names.push_back(name);
    throw invalid_input(fmt::format("{} {}: \"{}\" is unknown; a number, or one of {}", bsdf.place,
                                    property, printable(text), fmt::join(names, ", ")));
  }

  static bool is_air(double index) { return std::abs(index - 1) < 1e-3; }
  // Whether what refracts light at its surface is not air outside, beside another object.
  bool is_inside_another(const MitsubaPlugin& shape) const {
    const MitsubaPlugin* const bsdf = unwrapped_bsdf(shape);
    const bool refracts = bsdf && (bsdf->type == "dielectric" || bsdf->type == "roughdielectric");
    return result_.scene.has_object() && refracts && !is_air(index_of(*bsdf, "ext_ior", "air"));
  }

  void set_boundary(v1::Object& object, const MitsubaPlugin& shape) {
    const MitsubaPlugin* const bsdf = unwrapped_bsdf(shape);
    if (!bsdf) {
      leave(shape, "has no bsdf, and is opaque in Mitsuba; light enters its medium as it is here");
      return;
    }
    if (bsdf->type == "null") return;
    const bool smooth = bsdf->type == "dielectric";
    if (!smooth && bsdf->type != "roughdielectric") {
      leave(*bsdf,
            "the boundary of the medium is index-matched here; dielectric and roughdielectric have "
            "counterparts");
      return;
    }
    const double outside = index_of(*bsdf, "ext_ior", "air");
    if (!is_air(outside)) {
      leave(*bsdf, fmt::format("its ext_ior of {:.4g}: all is in that here, camera and lights too; "
                               "solids inside of solids have no counterpart",
                               outside));
    }
    const auto index = static_cast<float>(index_of(*bsdf, "int_ior", "bk7") / outside);
    if (smooth) {
      object.mutable_dielectric()->set_index(index);
    } else {
      v1::RoughDielectric& rough = *object.mutable_rough_dielectric();
      rough.set_index(index);
      rough.set_roughness(static_cast<float>(bsdf->number("alpha", bsdf->number("alpha_u", 0.1))));
      rough.set_single_scattering(true);
      if (bsdf->text("distribution", "beckmann") != "ggx") {
        leave(*bsdf, "its microfacets are of the distribution GGX here");
      }
    }
    object.set_smooth_angle_degrees(smooth_angle_of(shape));
  }

  // In degrees.
  float smooth_angle_of(const MitsubaPlugin& shape) {
    if (shape.type == "sphere") return 40;
    if (shape.type == "cube" || shape.text("face_normals", "false") == "true") return 0;
    leave(shape, "normals of vertices: triangles that meet under less than 40 degrees are smooth");
    return 40;
  }

  void set_medium(v1::Object& object, const MitsubaPlugin& medium) {
    if (medium.type != "homogeneous") {
      leave(medium, "only a homogeneous medium has a counterpart");
      return;
    }
    const double scale = medium.number("scale", 1) / options_.mm_per_scene_unit;
    if (medium.has("material")) {
      set_measured_medium(object, medium, scale);
      return;
    }
    std::array<Material, 3> material;
    const auto colour = [&](const char* name, double otherwise) {
      return colour_of(medium, name, otherwise);
    };
    const Colour albedo = colour("albedo", 0.75), sigma_t = colour("sigma_t", 1);
    const Colour sigma_s = colour("sigma_s", 0), sigma_a = colour("sigma_a", 0);
    const bool by_parts = medium.has("sigma_s") || medium.has("sigma_a");
    const bool by_whole = medium.has("sigma_t") || medium.has("albedo") ||
                          medium.child("volume", "albedo") || medium.child("volume", "sigma_t");
    if (by_parts && by_whole) {
      throw invalid_input(medium.place +
                          ": it has sigma_t or albedo beside sigma_s or sigma_a; it must have one "
                          "pair of them");
    }
    if (!by_parts && !by_whole && !file_.is_3) {
      leave(medium, "has no coefficients: Mitsuba 0.6 takes skin1 then, and so does this");
      return set_measured_medium(object, medium, scale);
    }
    const double g = asymmetry_of(medium, &object == &result_.scene.object());
    for (size_t c = 0; c < 3; ++c) {
      Material& of = material[c];
      of.sigma_t = by_parts ? sigma_s[c] + sigma_a[c] : sigma_t[c];
      of.albedo = !by_parts ? albedo[c] : of.sigma_t > 0 ? sigma_s[c] / of.sigma_t : 0;
      of.g = g;
      of.sigma_t *= scale;
    }
    set_material(object, medium, material);
  }

  // Sets the material that R, G and B have, in 1/mm.
  void set_material(v1::Object& object, const MitsubaPlugin& medium,
                    const std::array<Material, 3>& material) {
    for (size_t c = 0; c < 3; ++c) {
      itn::validate(material[c], fmt::format("{} ({})", medium.place, "RGB"[c]));
    }
    if (&object == &result_.scene.object()) {
      result_.medium = material;
      return;
    }
    add_materials(material, object);
  }

  // Mitsuba 0.6 has those of Jensen and Narasimhan in 1/mm, under names of which ours are the small
  // letters.
  void set_measured_medium(v1::Object& object, const MitsubaPlugin& medium, double scale) {
    std::string name = medium.text("material", "skin1");
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return std::tolower(c); });
    const auto known = std::ranges::find(measured_media(), name, &MeasuredMedium::name);
    if (known == measured_media().end()) {
      leave(medium, fmt::format("the material \"{}\"; `itn materials` lists those that are here",
                                printable(name)));
      return;
    }
    if (scale == 1) {
      object.mutable_medium()->set_name(name);
      return;
    }
    std::array<Material, 3> material;
    for (size_t c = 0; c < 3; ++c) {
      material[c] = known->material(c);
      material[c].sigma_t *= scale;
    }
    set_material(object, medium, material);
  }

  double asymmetry_of(const MitsubaPlugin& medium, bool is_first) {
    const MitsubaPlugin* const phase = medium.child("phase");
    if (!phase || phase->type == "isotropic") return medium.number("g", 0);
    if (phase->type == "hg") return phase->number("g", 0.8);
    if (phase->type == "blendphase" && is_first && set_two_terms(*phase)) return 0;
    leave(*phase,
          "scatters isotropically here; hg has a counterpart, and of the first object a "
          "blendphase of two of them");
    return 0;
  }

  // False if it is not of two terms that have counterparts.
  bool set_two_terms(const MitsubaPlugin& blend) {
    std::vector<double> g;
    for (const auto& [name, part] : blend.children) {
      if (part->tag != "phase" || (part->type != "hg" && part->type != "isotropic")) return false;
      g.push_back(part->type == "hg" ? part->number("g", 0.8) : 0);
      part->used = true;
    }
    if (g.size() != 2) return false;
    const double weight = blend.number("weight", 0.5);  // of the second
    const auto is_g = [](double value) { return std::abs(value) <= kMaxAbsG; };
    if (!std::ranges::all_of(g, is_g) || !(weight >= 0 && weight <= 1)) {
      throw invalid_input(fmt::format(
          "{}: g {} and {}, weight {}; each g must be in [-{}, {}], the weight in [0, 1]",
          blend.place, g[0], g[1], weight, kMaxAbsG, kMaxAbsG));
    }
    result_.phase =
        fmt::format("two_term {{ g_1: {} g_2: {} weight: {} }}", g[0], g[1], 1 - weight);
    return true;
  }

  void add_surface(const MitsubaPlugin& shape) {
    v1::Surface surface;
    if (shape.type == "rectangle") {
      set_sides(*surface.mutable_rectangle(), to_world(shape));
    } else if (set_mesh(*surface.mutable_mesh(), shape)) {
      surface.set_smooth_angle_degrees(smooth_angle_of(shape));
    } else {
      leave_out(shape, "has no counterpart, and is not there");
      return;
    }
    set_reflectance(surface, shape);
    *result_.scene.add_surfaces() = surface;
  }

  void set_reflectance(v1::Surface& surface, const MitsubaPlugin& shape) {
    const MitsubaPlugin* const bsdf = unwrapped_bsdf(shape);
    if (!bsdf) {
      surface.set_reflectance(0.5F);
      return;
    }
    if (bsdf->type != "diffuse") leave(*bsdf, "is diffuse here");
    if (shape.type == "rectangle" && shape.child("bsdf")->type != "twosided") {
      one_sided_.emplace_back(bsdf, to_world(shape));
    }
    constexpr std::array kNames{"reflectance", "diffuse_reflectance", "base_color"};
    for (const std::string name : kNames) {
      if (const MitsubaPlugin* const texture = bsdf->child("texture", name)) {
        if (set_texture(surface, shape, *texture)) return;
        leave(*texture, "is a reflectance of 0.5 here");
      } else if (bsdf->has(name)) {
        const Colour colour = colour_of(*bsdf, name, 0.5);
        if (is_kept(colour)) {
          set_color(colour, *surface.mutable_color());
        } else {
          surface.set_reflectance(number_of(colour));
        }
        return;
      }
    }
    surface.set_reflectance(0.5F);
  }

  // On a rectangle, whose texture coordinates go from 0 to 1 along its x and y.
  bool set_texture(v1::Surface& surface, const MitsubaPlugin& shape, const MitsubaPlugin& texture) {
    if (!surface.has_rectangle()) return false;
    // Of the first two coordinates.
    const Eigen::Matrix4d uv = texture.transform("to_uv").matrix();
    const Eigen::DiagonalMatrix<double, 2> scale(texture.number("uscale", 1),
                                                 texture.number("vscale", 1));
    const Eigen::Matrix2d to_texture = scale * uv.topLeftCorner<2, 2>();
    if (!(std::abs(to_texture.determinant()) > 0)) {
      throw invalid_input(texture.place + ": its to_uv makes it flat");
    }
    const Affine3d transform = to_world(shape);
    const Eigen::Matrix<double, 3, 2> sides = 2 * transform.linear().leftCols<2>();
    const Eigen::Matrix<double, 3, 2> edges = sides * to_texture.inverse();
    const Vector3d right = edges.col(0), up = edges.col(1);
    const Vector3d start =
        transform * Vector3d(-1, -1, 0) - edges * (scale * uv.topRightCorner<2, 1>());
    if (texture.type == "bitmap") {
      // The first row of its pixels is where v is 0.
      v1::ImageReflectance& image = *surface.mutable_image();
      image.set_path(path_of(texture));
      set(*image.mutable_corner(), start + up);
      set(*image.mutable_edge_u(), right);
      set(*image.mutable_edge_v(), -up);
      if (texture.text("filter_type", "bilinear") != "bilinear") {
        leave(texture, "its filter_type: pixels are interpolated here");
      }
      return true;
    }
    if (texture.type != "checkerboard") return false;
    v1::Checkerboard& board = *surface.mutable_checkerboard();
    board.set_even(number_for(texture, "color0", 0.4));
    board.set_odd(number_for(texture, "color1", 0.2));
    set(*board.mutable_corner(), start);
    set(*board.mutable_edge_u(), right / 2);
    set(*board.mutable_edge_v(), up / 2);
    return true;
  }

  // Lights.

  void add_lamp(const MitsubaPlugin& shape, const MitsubaPlugin& emitter) {
    if (const MitsubaPlugin* const texture = emitter.child("texture")) {
      leave(shape, "does not shine: a lamp here is as bright everywhere, and has no texture");
      leave_out(*texture, "was not carried over");
      return;
    }
    v1::Light light;
    const float radiance = brightness_of(emitter, "radiance", light);
    const Affine3d transform = to_world(shape);
    if (shape.type == "rectangle") {
      v1::PanelLight& panel = *light.mutable_panel();
      set_sides(panel, transform, flips(shape));
      panel.set_radiance(radiance);
    } else if (shape.type == "sphere") {
      v1::SphereLight& sphere = *light.mutable_sphere();
      set(*sphere.mutable_center(), transform * shape.vector("center", Vector3d::Zero()));
      const double scale = std::cbrt(std::abs(transform.linear().determinant()));
      sphere.set_radius(static_cast<float>(radius_of(shape) * scale));
      // A sphere stays one where the transform is a rotation times a number.
      const Eigen::Matrix3d scaled = transform.linear().transpose() * transform.linear();
      if (!scaled.isApprox(Eigen::Matrix3d::Identity() * scale * scale, 1e-3)) {
        leave(shape, "its to_world makes it an ellipsoid; it is a sphere of its volume here");
      }
      sphere.set_radiance(radiance);
    } else {
      leave_out(shape, "shines, and has no counterpart; rectangles and spheres have");
      return;
    }
    *result_.scene.add_lights() = light;
    const MitsubaPlugin* const bsdf = unwrapped_bsdf(shape);
    if (bsdf == nullptr) return;
    const bool is_black = bsdf->type == "diffuse" && bsdf->colour("reflectance", 0.5) == Colour{};
    if (!is_black) leave(*bsdf, "a lamp is black here");
  }

  // From W/sr over scene units^2.
  float intensity_of(const MitsubaPlugin& emitter, v1::Light& light) {
    const double mm2_per_m2 = 1e6;
    return static_cast<float>(brightness_of(emitter, "intensity", light) *
                              std::pow(options_.mm_per_scene_unit, 2) / mm2_per_m2);
  }

  void add_emitter(const MitsubaPlugin& emitter) {
    const Affine3d transform = to_world(emitter);
    v1::Light light;
    if (emitter.type == "constant") {
      light.mutable_constant()->set_radiance(brightness_of(emitter, "radiance", light));
    } else if (emitter.type == "envmap") {
      v1::EnvironmentMap& map = *light.mutable_environment_map();
      map.set_path(path_of(emitter));
      map.set_scale(static_cast<float>(emitter.number("scale", 1)));
      map.set_rotate_y_degrees(static_cast<float>(y_rotation_of(emitter, transform)));
    } else if (emitter.type == "directional") {
      v1::DirectionalLight& sun = *light.mutable_directional();
      const Vector3d along =
          emitter.has("direction")
              ? Vector3d(world_.linear() * emitter.vector("direction", Vector3d::UnitZ()))
              : Vector3d(transform.linear().col(2));
      set(*sun.mutable_direction(), -along.normalized());
      sun.set_irradiance(brightness_of(emitter, "irradiance", light));
    } else if (emitter.type == "point") {
      set(*light.mutable_point()->mutable_position(),
          transform * emitter.vector("position", Vector3d::Zero()));
      light.mutable_point()->set_intensity(intensity_of(emitter, light));
    } else if (emitter.type == "spot") {
      const double cutoff = emitter.number("cutoff_angle", 20);
      v1::SpotLight& spot = *light.mutable_spot();
      set(*spot.mutable_position(), transform.translation());
      set(*spot.mutable_target(), transform * Vector3d::UnitZ());
      spot.set_intensity(intensity_of(emitter, light));
      spot.set_outer_angle_degrees(static_cast<float>(cutoff));
      spot.set_inner_angle_degrees(static_cast<float>(emitter.number("beam_width", 0.75 * cutoff)));
      leave(emitter, "how it fades between its two angles differs");
    } else if (emitter.type == "sunsky" || emitter.type == "sun" || emitter.type == "sky") {
      set_sun_sky(*light.mutable_sun_sky(), emitter);
    } else {
      leave_out(emitter, "has no counterpart, and does not shine");
      return;
    }
    *result_.scene.add_lights() = light;
  }

  // About +y, in degrees, of what it does to +z.
  double y_rotation_of(const MitsubaPlugin& emitter, const Affine3d& transform) {
    const Vector3d up = transform.linear() * zenith_of(emitter), to = transform.linear().col(2);
    if (!(up.normalized().y() > 1 - 1e-6))
      leave(emitter, "stands askew beside another sky; that tilt");
    if (transform.linear().determinant() < 0)
      leave(emitter, "is a mirror image; that it is mirrored");
    return std::atan2(to.x(), to.z()) / kRadiansPerDegree;
  }

  void set_sun_sky(v1::SunSky& sky, const MitsubaPlugin& emitter) {
    sky.set_turbidity(static_cast<float>(emitter.number("turbidity", 3)));
    sky.set_ground_albedo(number_for(emitter, "albedo", file_.is_3 ? 0.3 : 0.15));
    if (emitter.has("sun_direction")) {  // in the world's coordinates, whatever to_world is
      const Vector3d direction =
          (world_.linear() * emitter.vector("sun_direction", Vector3d::UnitY())).normalized();
      sky.set_sun_elevation_degrees(
          static_cast<float>(std::max(0.0, std::asin(direction.y()) / kRadiansPerDegree)));
      sky.set_sun_azimuth_degrees(
          static_cast<float>(std::atan2(direction.x(), -direction.z()) / kRadiansPerDegree));
    } else {
      leave(emitter,
            "the sun's place by time and latitude: write sun_elevation_degrees and "
            "sun_azimuth_degrees");
    }
    // The model's radiance over the sum of CIE's curve y, which Mitsuba divides it by.
    constexpr double kSumOfY = 106.856980;
    const double scale = emitter.number("scale", 1) / kSumOfY;
    const double sun_scale = scale * emitter.number("sun_scale", 1);
    const double sky_scale = scale * emitter.number("sky_scale", 1);
    sky.set_sun_scale(emitter.type == "sky" ? 0 : static_cast<float>(sun_scale));
    sky.set_sky_scale(emitter.type == "sun" ? 0 : static_cast<float>(sky_scale));
    if (sky.sun_scale() == 0) return;
    const double degrees = 0.2665 * emitter.number("sun_radius_scale", 1);
    sky.set_sun_angular_radius_degrees(
        static_cast<float>(std::max(0.1, emitter.number("sun_aperture", 2 * degrees) / 2)));
    leave(emitter, "its sun: of another model here, and about 0.7 times as bright");
  }

  // The camera.

  // Defaults of Mitsuba's.
  static constexpr double kNearClip = 0.01, kFarClip = 1e4;

  void add_camera(const MitsubaPlugin& sensor) {
    sensor.used = true;
    if (sensor.type != "perspective" && sensor.type != "thinlens") {
      throw invalid_input(fmt::format("{}: a camera here is a pinhole: perspective", sensor.place));
    }
    if (sensor.type == "thinlens") leave(sensor, "everything is in focus here");
    const Affine3d transform = to_world(sensor);
    const Eigen::Matrix3d axes = transform.linear();
    if (axes.determinant() < 0) leave(sensor, "its image is mirrored; here it is not");
    const Eigen::RowVector3d lengths = axes.colwise().norm() / options_.mm_per_scene_unit;
    if (!lengths.isOnes(1e-4)) leave(sensor, "its transform scales; a camera here has no size");
    v1::Camera& camera = *result_.scene.mutable_camera();
    set(*camera.mutable_origin(), transform.translation());
    set(*camera.mutable_target(),
        transform.translation() + axes.col(2).normalized() * options_.mm_per_scene_unit);
    set(*camera.mutable_up(), axes.col(1).normalized());
    // What is seen without them is less.
    if (sensor.number("near_clip", kNearClip) > kNearClip)
      leave(sensor, "near_clip was not carried over");
    if (sensor.number("far_clip", kFarClip) < kFarClip)
      leave(sensor, "far_clip was not carried over");
    camera.set_principal_x(static_cast<float>(0.5 - sensor.number("principal_point_offset_x", 0)));
    camera.set_principal_y(static_cast<float>(0.5 - sensor.number("principal_point_offset_y", 0)));
    sensor.number("focus_distance", 0);

    const MitsubaPlugin* film = sensor.child("film");
    static const MitsubaPlugin kDefaults;
    if (!film) film = &kDefaults;
    const double width = film->number("width", 768), height = film->number("height", 576);
    const double left = film->number("crop_offset_x", 0), top = film->number("crop_offset_y", 0);
    const double cropped_width = film->number("crop_width", width),
                 cropped_height = film->number("crop_height", height);
    const double smallest = std::min({width, height, cropped_width, cropped_height});
    const double largest = std::max({width, height, cropped_width, cropped_height});
    constexpr double kMaxPixels = 65536;
    const auto is_whole = [](double number) { return number == std::floor(number); };
    const bool are_whole =
        is_whole(width) && is_whole(height) && is_whole(cropped_width) && is_whole(cropped_height);
    if (!(smallest >= 1 && largest <= kMaxPixels && are_whole)) {
      throw invalid_input(fmt::format(
          "{}: {} x {} pixels, cropped to {} x {}; each must be a whole number in [1, {}]",
          film->place, width, height, cropped_width, cropped_height, kMaxPixels));
    }
    if (!(left >= 0 && top >= 0 && left + cropped_width <= width &&
          top + cropped_height <= height)) {
      throw invalid_input(
          fmt::format("{}: its crop of {} x {} pixels from ({}, {}) on is not within {} x {}",
                      film->place, cropped_width, cropped_height, left, top, width, height));
    }
    film_is_gray_ = film->text("pixel_format", "rgb").starts_with("luminance");
    for (const char* const name : {"component_format", "file_format", "banner", "gamma", "variable",
                                   "attach_log", "sample_border"}) {
      film->text(name, "");
    }
    result_.scene.mutable_film()->set_width(static_cast<uint32_t>(cropped_width));
    result_.scene.mutable_film()->set_height(static_cast<uint32_t>(cropped_height));
    result_.scene.mutable_film()->set_channel(options_.channel);
    if (cropped_width != width || cropped_height != height) {
      v1::Crop& crop = *camera.mutable_crop();
      crop.set_left(static_cast<float>(left / width));
      crop.set_top(static_cast<float>(top / height));
      crop.set_right(static_cast<float>((left + cropped_width) / width));
      crop.set_bottom(static_cast<float>((top + cropped_height) / height));
    }
    camera.set_fov_degrees(static_cast<float>(horizontal_fov(sensor, width, height)));
    if (const MitsubaPlugin* const sampler = sensor.child("sampler")) {
      const double samples = sampler->number("sample_count", 0);
      result_.samples = static_cast<uint32_t>(std::clamp(samples, 0.0, double{kMaxSamples}));
      if (samples != result_.samples) {
        leave(*sampler, fmt::format("sample_count {}: it is {} here", samples, result_.samples));
      }
    }
  }

  // In degrees.
  static double horizontal_fov(const MitsubaPlugin& sensor, double width, double height) {
    std::string axis = sensor.text("fov_axis", "x");
    double half = 0;  // tangent of half of the angle
    if (sensor.has("focal_length") || !sensor.has("fov")) {
      // In mm, of a film of 36 x 24 mm, whose diagonal counts.
      std::string text = sensor.text("focal_length", "50mm");
      if (text.ends_with("mm")) text.resize(text.size() - 2);
      double length = 0;
      std::from_chars(text.data(), text.data() + text.size(), length);
      if (!(length > 0)) {
        throw invalid_input(
            fmt::format("{}: focal_length is \"{}\"; it must be above 0, as \"50mm\"", sensor.place,
                        sensor.text("focal_length", "")));
      }
      half = std::hypot(36, 24) / (2 * length);
      axis = "diagonal";
    } else {
      half = std::tan(sensor.number("fov", 0) / 2 * kRadiansPerDegree);
      if (!(half > 0))
        throw invalid_input(sensor.place + ": fov must be above 0 and below 180 degrees");
    }
    constexpr std::array kAxes{"x", "y", "diagonal", "smaller", "larger"};
    if (std::ranges::find(kAxes, axis) == kAxes.end()) {
      throw invalid_input(fmt::format("{}: fov_axis is \"{}\"; it must be {}", sensor.place,
                                      printable(axis), fmt::join(kAxes, ", ")));
    }
    if (axis == "smaller") axis = width < height ? "x" : "y";
    if (axis == "larger") axis = width < height ? "y" : "x";
    if (axis == "y") half *= width / height;
    if (axis == "diagonal") half *= width / std::hypot(width, height);
    return 2 * std::atan(half) / kRadiansPerDegree;
  }

  const ImportOptions& options_;
  const fs::path folder_;
  const MitsubaFile file_;
  std::set<const MitsubaPlugin*> visited_;                            // by leave_unused
  std::vector<std::pair<const MitsubaPlugin*, Affine3d>> one_sided_;  // of rectangles
  bool film_is_gray_ = false;
  Affine3d world_;  // from the coordinates of the file to ours, in mm
  ImportedScene result_;
};

}  // namespace

void add_materials(const std::array<Material, 3>& materials, v1::Object& object) {
  const bool one = materials[0] == materials[1] && materials[1] == materials[2];
  for (const Material& material : std::span(materials).first(one ? 1 : 3)) {
    *object.add_material() = to_proto(material);
  }
}

ImportedScene import_mitsuba(const fs::path& path, const ImportOptions& options) {
  return Importer(path, options).run();
}

}  // namespace itn
