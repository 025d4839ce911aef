#include "server/render/light_builder.h"

#include <fmt/format.h>

#include <cmath>

#include "common/angle.h"
#include "common/error.h"
#include "common/scene/field_check.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace {

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

// Of a panorama, where a sun may be far above all else. Its fourth power is a float's.
constexpr double kMaxRadiance = 1e9;

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
  if (proto.has_scale()) light.scale = in_closed(field + ".scale", proto.scale(), 0, 1e6);
  light.rgb = array_of<float>(pixels + ".rgb", proto.pixels().rgb());
  for (size_t i = 0; i < light.rgb.size(); ++i) {
    if (!(light.scale * light.rgb[i] >= 0 && light.scale * light.rgb[i] <= kMaxRadiance)) {
      throw invalid_input(fmt::format(
          "{}.rgb is {} at x = {}, y = {}; times the scale it must be in [0, {:g}]", pixels,
          light.rgb[i], i / 3 % light.width, i / 3 / light.width, kMaxRadiance));
    }
  }
  light.digest = sha256(proto.pixels().rgb());
  light.rotate_y = proto.rotate_y_degrees() * kRadiansPerDegree;
  return light;
}

}  // namespace

tracer::LightDescription build_light(const std::string& field, const v1::Light& proto) {
  switch (proto.kind_case()) {
    case v1::Light::kSunSky: return build_sun_sky(field + ".sun_sky", proto.sun_sky());
    case v1::Light::kEnvironmentMap:
      return build_environment_map(field + ".environment_map", proto.environment_map());
    case v1::Light::kConstant: {
      tracer::ConstantLight light;
      if (proto.constant().has_radiance()) {
        light.radiance =
            in_closed(field + ".constant.radiance", proto.constant().radiance(), 0, 1e9);
      }
      return light;
    }
    case v1::Light::kDirectional: {
      tracer::DirectionalLight light;
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

}  // namespace itn
