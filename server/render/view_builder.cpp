#include "server/render/view_builder.h"

#include <fmt/format.h>

#include "common/angle.h"
#include "common/error.h"
#include "common/scene/field_check.h"

namespace itn {
namespace {

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

}  // namespace

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

tracer::FilmDescription build_film(const v1::Film& proto, uint64_t max_pixels) {
  tracer::FilmDescription film;
  film.width = static_cast<int>(integer_in("scene.film.width", proto.width(), 1, 65536));
  film.height = static_cast<int>(integer_in("scene.film.height", proto.height(), 1, 65536));
  within_limit("the number of pixels of scene.film", uint64_t{proto.width()} * proto.height(),
               max_pixels);
  film.channel = build_channel(proto.channel());
  return film;
}

}  // namespace itn
