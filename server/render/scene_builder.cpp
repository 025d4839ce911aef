#include "server/render/scene_builder.h"

#include <fmt/format.h>
#include <google/protobuf/message.h>
#include <google/protobuf/unknown_field_set.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <set>
#include <vector>

#include "common/error.h"
#include "common/geometry/mesh.h"
#include "common/geometry/shapes.h"
#include "common/rpc/wire_array.h"

namespace itn {
namespace {

static_assert(std::endian::native == std::endian::little, "the wire's arrays are little-endian");

constexpr double kRadiansPerDegree = std::numbers::pi / 180;
constexpr double kMaxCoordinate = 1e6;  // in mm; squares of distances stay finite in float

// ---- Checks of single values ---------------------------------------------------------------

Error missing(const std::string& field) {
  return invalid_input(fmt::format("{} is missing; it is required", field));
}

// Negated comparisons, so that NaN fails too.
double in_closed(const std::string& field, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw invalid_input(
        fmt::format("{} is {}; it must be in [{:.6g}, {:.6g}]", field, value, low, high));
  }
  return value;
}

uint32_t integer_in(const std::string& field, uint64_t value, uint64_t low, uint64_t high) {
  if (value < low || value > high) {
    throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", field, value, low, high));
  }
  return static_cast<uint32_t>(value);
}

void within_limit(const std::string& what, uint64_t value, uint64_t limit) {
  if (value > limit) {
    throw Error(ErrorKind::kLimit,
                fmt::format("{} is {}; this worker accepts at most {}", what, value, limit));
  }
}

// ---- Checks of any message: no unknown fields, all numbers finite ----------------------------

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

void check_message(const Message& message, const std::string& path);

void check_finite(double value, const std::string& path) {
  if (!std::isfinite(value)) {
    throw invalid_input(fmt::format("{} is {}; it must be finite", path, value));
  }
}

void check_single(const Message& message, const FieldDescriptor& field, const std::string& path) {
  const auto& reflection = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return check_message(reflection.GetMessage(message, &field), path);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return check_finite(reflection.GetFloat(message, &field), path);
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return check_finite(reflection.GetDouble(message, &field), path);
    default: return;
  }
}

void check_element(const Message& message, const FieldDescriptor& field, int i,
                   const std::string& path) {
  const auto& reflection = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return check_message(reflection.GetRepeatedMessage(message, &field, i), path);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return check_finite(reflection.GetRepeatedFloat(message, &field, i), path);
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return check_finite(reflection.GetRepeatedDouble(message, &field, i), path);
    default: return;
  }
}

void check_message(const Message& message, const std::string& path) {
  const auto& reflection = *message.GetReflection();
  if (const auto& unknown = reflection.GetUnknownFields(message); !unknown.empty()) {
    throw invalid_input(
        fmt::format("{} has a field with the unknown number {}", path, unknown.field(0).number()));
  }
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    const std::string name = path + "." + field->name();
    if (!field->is_repeated()) {
      check_single(message, *field, name);
      continue;
    }
    for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
      check_element(message, *field, i, fmt::format("{}[{}]", name, i));
    }
  }
}

// ---- Meshes --------------------------------------------------------------------------------

Vec3d to_vec(const v1::Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

Vec3d non_zero(const std::string& field, const v1::Vec3& proto) {
  const Vec3d v = to_vec(proto);
  if (!(length(v) > 0)) {
    throw invalid_input(fmt::format("{} is (0, 0, 0); it must have a length", field));
  }
  return v;
}

Vec3d check_position(const std::string& field, Vec3d p) {
  for (const double c : {p.x, p.y, p.z}) {
    // Negated so that NaN fails too.
    if (!(std::abs(c) <= kMaxCoordinate)) {
      throw invalid_input(fmt::format("{} has a coordinate of {} mm; it must be in [{}, {}]", field,
                                      c, -kMaxCoordinate, kMaxCoordinate));
    }
  }
  return p;
}

template <typename T>
std::vector<T> array_of(const std::string& field, const std::string& bytes) {
  if (bytes.empty()) throw missing(field);
  if (bytes.size() % sizeof(T) != 0) {
    throw invalid_input(fmt::format("{} has {} bytes; it must be a multiple of {}", field,
                                    bytes.size(), sizeof(T)));
  }
  return from_bytes<T>(bytes);
}

constexpr Affine kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

// First b, then a.
Affine compose(const Affine& a, const Affine& b) {
  Affine product{};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      double sum = column == 3 ? a[4 * row + 3] : 0;
      for (int k = 0; k < 3; ++k) sum += a[4 * row + k] * b[4 * k + column];
      product[4 * row + column] = sum;
    }
  }
  return product;
}

double determinant(const Affine& m) {
  return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
         m[2] * (m[4] * m[9] - m[5] * m[8]);
}

// Rodrigues' formula, R = cos I + sin [k]x + (1 - cos) k k^T.
Affine rotation(Vec3d axis, double angle) {
  const Vec3d k = normalize(axis);
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const double t = 1 - c;
  return {c + t * k.x * k.x,       t * k.x * k.y - s * k.z, t * k.x * k.z + s * k.y, 0,
          t * k.x * k.y + s * k.z, c + t * k.y * k.y,       t * k.y * k.z - s * k.x, 0,
          t * k.x * k.z - s * k.y, t * k.y * k.z + s * k.x, c + t * k.z * k.z,       0};
}

Affine build_scale(const std::string& field, const v1::Vec3& proto) {
  const Vec3d s = to_vec(proto);
  if (!(s.x * s.y * s.z > 0)) {
    throw invalid_input(fmt::format(
        "{} is ({}, {}, {}); the product of the factors must be positive (no mirror image)", field,
        s.x, s.y, s.z));
  }
  return {s.x, 0, 0, 0, 0, s.y, 0, 0, 0, 0, s.z, 0};
}

Affine build_matrix(const std::string& field, const v1::Matrix& proto) {
  if (proto.m_size() != 16) {
    throw invalid_input(fmt::format("{}.m has {} numbers; it must have 16", field, proto.m_size()));
  }
  if (proto.m(12) != 0 || proto.m(13) != 0 || proto.m(14) != 0 || proto.m(15) != 1) {
    throw invalid_input(fmt::format("the last row of {}.m must be 0 0 0 1", field));
  }
  Affine affine{};
  for (int i = 0; i < 12; ++i) affine[i] = proto.m(i);
  if (!(determinant(affine) > 0)) {
    throw invalid_input(fmt::format("the determinant of {}.m is {}; it must be positive", field,
                                    determinant(affine)));
  }
  return affine;
}

Affine build_transform(const std::string& field, const v1::Transform& proto) {
  switch (proto.kind_case()) {
    case v1::Transform::kTranslate: {
      const Vec3d t = to_vec(proto.translate());
      return {1, 0, 0, t.x, 0, 1, 0, t.y, 0, 0, 1, t.z};
    }
    case v1::Transform::kRotate:
      return rotation(non_zero(field + ".rotate.axis", proto.rotate().axis()),
                      proto.rotate().angle_degrees() * kRadiansPerDegree);
    case v1::Transform::kScale: return build_scale(field + ".scale", proto.scale());
    case v1::Transform::kMatrix: return build_matrix(field + ".matrix", proto.matrix());
    case v1::Transform::KIND_NOT_SET: break;
  }
  throw missing(field + ": one of translate, rotate, scale and matrix");
}

// Builds meshes as long as all of them together stay within the limit of triangles.
class MeshBuilder {
 public:
  explicit MeshBuilder(uint64_t max_triangles) : max_triangles_(max_triangles) {}

  Mesh build(const std::string& field, const v1::Mesh& proto) {
    Mesh mesh = source(field, proto);
    if (proto.normalize()) mesh = normalized(mesh);
    if (proto.transforms_size() > 0) mesh = place(field, mesh, proto);
    check_extent(field, mesh);
    return mesh;
  }

  void count(uint64_t triangles) {
    triangles_ += triangles;
    within_limit("the number of triangles of the scene", triangles_, max_triangles_);
  }

 private:
  Mesh source(const std::string& field, const v1::Mesh& proto) {
    switch (proto.source_case()) {
      case v1::Mesh::kTriangles: return from_triangles(field + ".triangles", proto.triangles());
      case v1::Mesh::kBuiltin: {
        Mesh mesh = make_shape(proto.builtin());
        count(mesh.triangles.size());
        return mesh;
      }
      case v1::Mesh::kPath:
        throw invalid_input(
            fmt::format("{}.path is set; a worker opens no files: send the triangles", field));
      case v1::Mesh::SOURCE_NOT_SET: break;
    }
    throw missing(field + ": one of triangles, path and builtin");
  }

  Mesh from_triangles(const std::string& field, const v1::Triangles& proto) {
    count(proto.indices().size() / sizeof(std::array<uint32_t, 3>));
    Mesh mesh{array_of<Vec3f>(field + ".positions", proto.positions()),
              array_of<std::array<uint32_t, 3>>(field + ".indices", proto.indices())};
    validate_triangles(mesh, field);
    return welded(mesh);
  }

  static Mesh place(const std::string& field, const Mesh& mesh, const v1::Mesh& proto) {
    Affine affine = kIdentity;
    for (int i = 0; i < proto.transforms_size(); ++i) {
      affine = compose(
          build_transform(fmt::format("{}.transforms[{}]", field, i), proto.transforms(i)), affine);
    }
    return transformed(mesh, affine);
  }

  static void check_extent(const std::string& field, const Mesh& mesh) {
    if (mesh.triangles.empty()) {
      throw invalid_input(fmt::format("{} has only triangles that repeat a vertex", field));
    }
    for (const Vec3f v : mesh.vertices) {
      check_position(field + ", after its transforms,", static_cast<Vec3d>(v));
    }
  }

  uint64_t max_triangles_;
  uint64_t triangles_ = 0;
};

// ---- Surfaces, lights, camera, film ----------------------------------------------------------

Mesh build_rectangle(const std::string& field, const v1::Rectangle& proto) {
  const Vec3d center = to_vec(proto.center());
  const Vec3d u = non_zero(field + ".half_u", proto.half_u());
  const Vec3d v = non_zero(field + ".half_v", proto.half_v());
  if (!(length(cross(u, v)) > 1e-6 * length(u) * length(v))) {
    throw invalid_input(fmt::format("{}: half_u and half_v must not be parallel", field));
  }
  Mesh mesh;
  for (const Vec3d corner : {center - u - v, center + u - v, center + u + v, center - u + v}) {
    mesh.vertices.push_back(static_cast<Vec3f>(check_position(field, corner)));
  }
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

tracer::DiffuseSurface build_surface(const std::string& field, const v1::Surface& proto,
                                     MeshBuilder& meshes) {
  tracer::DiffuseSurface surface;
  if (proto.has_reflectance()) {
    surface.reflectance =
        static_cast<float>(in_closed(field + ".reflectance", proto.reflectance(), 0, 1));
  }
  switch (proto.shape_case()) {
    case v1::Surface::kRectangle:
      meshes.count(2);
      surface.mesh = build_rectangle(field + ".rectangle", proto.rectangle());
      return surface;
    case v1::Surface::kMesh:
      surface.mesh = meshes.build(field + ".mesh", proto.mesh());
      return surface;
    case v1::Surface::SHAPE_NOT_SET: break;
  }
  throw missing(field + ": one of rectangle and mesh");
}

tracer::SunSkyLight build_sun_sky(const std::string& field, const v1::SunSky& proto) {
  tracer::SunSkyLight light;
  if (proto.has_turbidity()) {
    light.turbidity = in_closed(field + ".turbidity", proto.turbidity(), 1, 10);
  }
  if (proto.has_ground_albedo()) {
    light.ground_albedo = in_closed(field + ".ground_albedo", proto.ground_albedo(), 0, 1);
  }
  const double elevation =
      proto.has_sun_elevation_degrees()
          ? in_closed(field + ".sun_elevation_degrees", proto.sun_elevation_degrees(), 0, 90)
          : 60;
  const double radius = proto.has_sun_angular_radius_degrees()
                            ? in_closed(field + ".sun_angular_radius_degrees",
                                        proto.sun_angular_radius_degrees(), 0.1F, 45)
                            : 0.2665;
  light.sun_elevation = elevation * kRadiansPerDegree;
  light.sun_angular_radius = radius * kRadiansPerDegree;
  light.sun_azimuth = proto.sun_azimuth_degrees() * kRadiansPerDegree;
  if (proto.has_sun_scale()) {
    light.sun_scale = in_closed(field + ".sun_scale", proto.sun_scale(), 0, 1e6);
  }
  if (proto.has_sky_scale()) {
    light.sky_scale = in_closed(field + ".sky_scale", proto.sky_scale(), 0, 1e6);
  }
  return light;
}

void check_pixels(const std::string& field, const v1::Pixels& proto) {
  integer_in(field + ".width", proto.width(), 1, 16384);
  integer_in(field + ".height", proto.height(), 1, 8192);
  const uint64_t expected = uint64_t{3} * sizeof(float) * proto.width() * proto.height();
  if (proto.rgb().size() != expected) {
    throw invalid_input(fmt::format("{}.rgb has {} bytes; {} x {} pixels take {}", field,
                                    proto.rgb().size(), proto.width(), proto.height(), expected));
  }
}

tracer::EnvironmentMapLight build_environment_map(const std::string& field,
                                                  const v1::EnvironmentMap& proto) {
  if (proto.source_case() == v1::EnvironmentMap::kPath) {
    throw invalid_input(
        fmt::format("{}.path is set; a worker opens no files: send the pixels", field));
  }
  if (proto.source_case() != v1::EnvironmentMap::kPixels) {
    throw missing(field + ": one of pixels and path");
  }
  const std::string pixels = field + ".pixels";
  check_pixels(pixels, proto.pixels());
  tracer::EnvironmentMapLight light;
  light.width = static_cast<int>(proto.pixels().width());
  light.height = static_cast<int>(proto.pixels().height());
  light.rgb = array_of<float>(pixels + ".rgb", proto.pixels().rgb());
  for (size_t i = 0; i < light.rgb.size(); ++i) {
    if (!(light.rgb[i] >= 0 && std::isfinite(light.rgb[i]))) {
      throw invalid_input(fmt::format("{}.rgb is {} at x = {}, y = {}; it must be finite and >= 0",
                                      pixels, light.rgb[i], i / 3 % light.width,
                                      i / 3 / light.width));
    }
  }
  if (proto.has_scale()) light.scale = in_closed(field + ".scale", proto.scale(), 0, 1e6);
  light.rotate_y = proto.rotate_y_degrees() * kRadiansPerDegree;
  return light;
}

tracer::LightDescription build_light(const std::string& field, const v1::Light& proto) {
  switch (proto.kind_case()) {
    case v1::Light::kSunSky: return build_sun_sky(field + ".sun_sky", proto.sun_sky());
    case v1::Light::kEnvironmentMap:
      return build_environment_map(field + ".environment_map", proto.environment_map());
    case v1::Light::kConstant: {
      tracer::ConstantEnvironment light;
      if (proto.constant().has_radiance()) {
        light.radiance =
            in_closed(field + ".constant.radiance", proto.constant().radiance(), 0, 1e9);
      }
      return light;
    }
    case v1::Light::kDirectional: {
      tracer::DirectionalBeam light;
      light.direction =
          normalize(non_zero(field + ".directional.direction", proto.directional().direction()));
      if (proto.directional().has_irradiance()) {
        light.irradiance =
            in_closed(field + ".directional.irradiance", proto.directional().irradiance(), 0, 1e9);
      }
      return light;
    }
    case v1::Light::KIND_NOT_SET: break;
  }
  throw missing(field + ": one of sun_sky, environment_map, constant and directional");
}

tracer::CameraDescription build_camera(const v1::Camera& proto) {
  tracer::CameraDescription camera;
  camera.origin = check_position("scene.camera.origin", to_vec(proto.origin()));
  camera.target = check_position("scene.camera.target", to_vec(proto.target()));
  const Vec3d direction = camera.target - camera.origin;
  if (!(length(direction) > 0)) {
    throw invalid_input("scene.camera.target is the origin of the camera; they must differ");
  }
  if (proto.has_up()) camera.up = non_zero("scene.camera.up", proto.up());
  if (!(length(cross(direction, camera.up)) > 1e-6 * length(direction) * length(camera.up))) {
    throw invalid_input("scene.camera.up is parallel to the direction of view; it must not be");
  }
  double fov = 40;
  if (proto.has_fov_degrees()) {
    fov = proto.fov_degrees();
    if (!(fov > 0 && fov < 179)) {
      throw invalid_input(
          fmt::format("scene.camera.fov_degrees is {}; it must be in (0, 179)", fov));
    }
  }
  camera.fov = fov * kRadiansPerDegree;
  return camera;
}

tracer::Channel build_channel(v1::Film::Channel channel) {
  switch (channel) {
    case v1::Film::LUMINANCE: return tracer::Channel::kLuminance;
    case v1::Film::RED: return tracer::Channel::kRed;
    case v1::Film::GREEN: return tracer::Channel::kGreen;
    case v1::Film::BLUE: return tracer::Channel::kBlue;
    default: break;
  }
  throw invalid_input(
      fmt::format("scene.film.channel has the unknown value {}", static_cast<int>(channel)));
}

tracer::FilmDescription build_film(const v1::Film& proto, const RenderLimits& limits) {
  tracer::FilmDescription film;
  film.width = static_cast<int>(integer_in("scene.film.width", proto.width(), 1, 65536));
  film.height = static_cast<int>(integer_in("scene.film.height", proto.height(), 1, 65536));
  within_limit("the number of pixels of scene.film", uint64_t{proto.width()} * proto.height(),
               limits.max_pixels);
  film.channel = build_channel(proto.channel());
  return film;
}

void check_required(const v1::Scene& scene) {
  if (!scene.has_object()) throw missing("scene.object");
  if (!scene.object().has_mesh()) throw missing("scene.object.mesh");
  if (scene.lights().empty()) throw missing("scene.lights: at least one");
  if (!scene.has_camera()) throw missing("scene.camera");
  if (!scene.has_film()) throw missing("scene.film");
  integer_in("the number of scene.lights", scene.lights_size(), 1, kMaxLights);
  if (scene.object().boundary() != v1::Object::INDEX_MATCHED) {
    throw invalid_input(fmt::format("scene.object.boundary has the unknown value {}",
                                    static_cast<int>(scene.object().boundary())));
  }
}

// ---- Requests ------------------------------------------------------------------------------

void build_sample_range(const v1::RenderGradRequest& request, tracer::RenderSettings& settings) {
  settings.first_sample = 0;
  settings.sample_count = request.spp();
  if (!request.has_sample_range()) return;
  const v1::SampleRange& range = request.sample_range();
  if (range.count() < 1 || uint64_t{range.first()} + range.count() > request.spp()) {
    throw invalid_input(fmt::format(
        "sample_range is [{}, {}); it must hold at least one sample and end at most at spp = {}",
        range.first(), uint64_t{range.first()} + range.count(), request.spp()));
  }
  settings.first_sample = range.first();
  settings.sample_count = range.count();
}

void check_loss(const v1::RenderGradRequest& request) {
  if (!request.has_loss()) return;
  if (request.estimates() < 2) {
    throw invalid_input(fmt::format(
        "estimates is {}; a loss needs at least 2, as products of an estimate with itself are "
        "biased",
        request.estimates()));
  }
  if (request.exact_sums()) {
    throw invalid_input("loss and exact_sums cannot both be asked for");
  }
  if (!request.albedos().empty()) {
    throw invalid_input("loss and albedos cannot both be asked for");
  }
}

// Values of an image of the target; `positive`: none may be negative.
std::vector<float> target_values(const char* name, const std::string& bytes, int width, int height,
                                 bool positive) {
  const size_t expected = static_cast<size_t>(width) * static_cast<size_t>(height) * sizeof(float);
  if (bytes.size() != expected) {
    throw invalid_input(fmt::format("{} has {} bytes; {} x {} float32 have {}", name, bytes.size(),
                                    width, height, expected));
  }
  std::vector<float> values = from_bytes<float>(bytes);
  for (size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i]) || (positive && values[i] < 0)) {
      throw invalid_input(fmt::format("{}: value {} is {}; it must be finite{}", name, i, values[i],
                                      positive ? " and not negative" : ""));
    }
  }
  return values;
}

void check_target(const v1::LossTarget& loss, int width, int height) {
  const auto image = target_values("loss.image", loss.image(), width, height, false);
  const auto weight = target_values("loss.weight", loss.weight(), width, height, true);
  for (size_t i = 0; i < image.size(); ++i) {
    if (image[i] * weight[i] != 0) return;
  }
  throw invalid_input("loss: the image is black where its weight is not 0");
}

void build_albedos(const v1::RenderGradRequest& request, tracer::RenderSettings& settings) {
  integer_in("the number of albedos", request.albedos_size(), 0, int{tracer::kMaxAlbedos});
  for (int i = 0; i < request.albedos_size(); ++i) {
    if (!(request.albedos(i) >= 0 && request.albedos(i) <= settings.material.albedo)) {
      throw invalid_input(
          fmt::format("albedos[{}] is {}; it must be in [0, {}], the albedo of the material", i,
                      request.albedos(i), settings.material.albedo));
    }
    settings.albedos.push_back(request.albedos(i));
  }
}

void build_tracer(const v1::RenderGradRequest& request, tracer::RenderSettings& settings) {
  if (!v1::RenderedPixels_IsValid(request.pixels())) {
    throw invalid_input(
        fmt::format("pixels has the unknown value {}", static_cast<int>(request.pixels())));
  }
  if (!v1::Tracer_IsValid(request.tracer())) {
    throw invalid_input(
        fmt::format("tracer has the unknown value {}", static_cast<int>(request.tracer())));
  }
  settings.pixels =
      request.pixels() == v1::OBJECT_PIXELS ? tracer::Pixels::kObject : tracer::Pixels::kAll;
  settings.pilot_spp = integer_in("pilot_spp", request.pilot_spp(), 0, 64);
  if (request.tracer() == v1::REFERENCE) {
    settings.tracer = tracer::Tracer::kReference;
    if (!request.albedos().empty() || request.pilot_spp() > 0) {
      throw invalid_input("the REFERENCE tracer knows neither albedos nor pilot_spp");
    }
  }
}

void check_derivatives(const v1::RenderGradRequest& request) {
  std::set<int> seen;
  for (int i = 0; i < request.derivatives_size(); ++i) {
    const v1::Parameter parameter = request.derivatives(i);
    if (parameter == v1::PARAMETER_UNSPECIFIED || !v1::Parameter_IsValid(parameter)) {
      throw invalid_input(fmt::format("derivatives[{}] is {}; it must be in [{}, {}]", i,
                                      static_cast<int>(parameter), v1::Parameter_MIN + 1,
                                      static_cast<int>(v1::Parameter_MAX)));
    }
    if (!seen.insert(parameter).second) {
      throw invalid_input(
          fmt::format("derivatives[{}] is {} again", i, v1::Parameter_Name(parameter)));
    }
  }
}

void check_scene_fields(const v1::RenderGradRequest& request) {
  if (request.scene().empty() && request.scene_digest().empty()) {
    throw missing("scene or scene_digest");
  }
  if (const size_t size = request.scene_digest().size(); size != 0 && size != 32) {
    throw invalid_input(fmt::format("scene_digest has {} bytes; a SHA-256 has 32", size));
  }
}

}  // namespace

v1::Scene parse_scene(const std::string& bytes) {
  v1::Scene scene;
  if (!scene.ParseFromString(bytes)) {
    throw invalid_input(
        fmt::format("scene: these {} bytes are not a serialized itn.v1.Scene", bytes.size()));
  }
  return scene;
}

tracer::SceneDescription build_scene(const v1::Scene& scene, const RenderLimits& limits) {
  check_required(scene);
  check_message(scene, "scene");
  tracer::SceneDescription description;
  description.film = build_film(scene.film(), limits);
  description.camera = build_camera(scene.camera());
  MeshBuilder meshes(limits.max_triangles);
  description.object = meshes.build("scene.object.mesh", scene.object().mesh());
  for (int i = 0; i < scene.surfaces_size(); ++i) {
    description.surfaces.push_back(
        build_surface(fmt::format("scene.surfaces[{}]", i), scene.surfaces(i), meshes));
  }
  for (int i = 0; i < scene.lights_size(); ++i) {
    description.lights.push_back(build_light(fmt::format("scene.lights[{}]", i), scene.lights(i)));
  }
  return description;
}

Material build_material(const v1::Material& proto) {
  const Material material{proto.sigma_t(), proto.albedo(), proto.g()};
  validate(material);
  return material;
}

tracer::RenderSettings build_settings(const v1::RenderGradRequest& request,
                                      const RenderLimits& limits) {
  check_message(request, "request");
  check_scene_fields(request);
  if (!request.has_material()) throw missing("material");
  integer_in("spp", request.spp(), 1, 1U << 20);
  within_limit("spp", request.spp(), limits.max_spp);
  tracer::RenderSettings settings;
  settings.material = build_material(request.material());
  settings.seed = request.seed();
  build_sample_range(request, settings);
  check_derivatives(request);
  settings.derivatives = !request.derivatives().empty() || request.has_loss();
  check_loss(request);
  build_albedos(request, settings);
  build_tracer(request, settings);
  settings.spp = request.spp();
  const uint32_t most = std::min(kMaxEstimates, settings.sample_count);
  settings.estimates =
      request.estimates() == 0 ? 1 : integer_in("estimates", request.estimates(), 1, most);
  return settings;
}

void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits) {
  const uint64_t estimates = std::max(request.estimates(), 1U);
  const uint64_t derivatives = request.derivatives_size();
  const uint64_t albedos = request.albedos_size();
  const uint64_t pixels = static_cast<uint64_t>(width) * height;
  if (request.has_loss()) check_target(request.loss(), width, height);
  // Estimates, mask and standard error; or sums and counts, squares and hits.
  const uint64_t sums = derivatives > 0 ? 1 + tracer::kCoordinates : 1;
  const uint64_t bytes_per_pixel =
      request.exact_sums()
          ? sizeof(int64_t) * (estimates * (sums + albedos) + 2) + sizeof(uint32_t) * estimates
          : sizeof(float) * (estimates * (1 + derivatives + albedos) + 2);
  const uint64_t bytes = bytes_per_pixel * pixels;
  if (bytes > limits.max_message_bytes) {
    throw Error(ErrorKind::kLimit,
                fmt::format("the images of the reply would take {} bytes; this worker sends at "
                            "most {}: ask for fewer pixels, estimates or derivatives",
                            bytes, limits.max_message_bytes));
  }
}

}  // namespace itn
