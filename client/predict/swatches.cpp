#include "client/predict/swatches.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <utility>

#include "client/dataset/studio.h"
#include "client/image/preview.h"
#include "client/interrupt.h"
#include "client/render/job_renderer.h"
#include "client/render/render_query.h"
#include "common/error.h"
#include "common/geometry/mesh.h"
#include "common/scene/material_proto.h"
#include "common/scene/mesh_builder.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

// --- One image in several channels ---

// Not those of the image that it may be compared with, which people number from 0.
constexpr uint64_t kSeed = uint64_t{1} << 40;

using Channels = std::vector<std::future<v1::RenderGradReply>>;

Channels submit(JobRenderer& pool, v1::Scene scene, std::span<const Material> materials,
                uint32_t spp, v1::RenderedPixels pixels) {
  Channels channels;
  for (size_t c = 0; c < materials.size(); ++c) {
    if (materials.size() == 3) {
      scene.mutable_film()->set_channel(
          std::array{v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE}[c]);
    }
    channels.push_back(pool.submit(job_of({.scene = serialize(scene),
                                           .material = materials[c],
                                           .spp = spp,
                                           .seed = kSeed,
                                           .pixels = pixels})));
  }
  return channels;
}

std::vector<float> interleaved(Channels channels) {
  std::vector<float> result;
  for (size_t c = 0; c < channels.size(); ++c) {
    const Render render = render_of(wait_for_render(channels[c], interruption()));
    const std::vector<float>& plane = render.estimates.front().radiance;
    result.resize(plane.size() * channels.size());
    for (size_t p = 0; p < plane.size(); ++p) result[p * channels.size() + c] = plane[p];
  }
  return result;
}

// --- Swatches ---

constexpr int kSide = 256;  // in pixels

// Sun from the side and a little from behind, so that some of it comes through.
v1::Light sun_and_sky() {
  v1::Light light;
  v1::SunSky& sun = *light.mutable_sun_sky();
  sun.set_sun_elevation_degrees(40);
  sun.set_sun_azimuth_degrees(105);
  sun.set_sun_angular_radius_degrees(4);  // wider than the real one: less noise
  return light;
}

v1::Emitter emitter(float azimuth, float elevation, float size, float strength) {
  v1::Emitter result;
  result.set_azimuth_degrees(azimuth);
  result.set_elevation_degrees(elevation);
  result.set_size_degrees(size);
  result.set_aspect(0.7F);
  result.set_edge(0.3F);
  result.set_strength(strength);
  return result;
}

// A large soft box at the camera's left, a smaller one behind the object.
v1::Light studio() {
  v1::Studio studio;
  studio.set_irradiance(100);
  studio.set_walls(0.35F);
  *studio.add_emitters() = emitter(-45, 45, 70, 1);
  *studio.add_emitters() = emitter(150, 40, 45, 0.7F);
  v1::Light light;
  *light.mutable_environment_map()->mutable_pixels() = studio_panorama(studio);
  return light;
}

v1::Vec3 vec3(float x, float y, float z) {
  v1::Vec3 result;
  result.set_x(x);
  result.set_y(y);
  result.set_z(z);
  return result;
}

// The shape on the ground, seen from far away and a little above.
v1::Scene scene_of(const std::string& shape, const v1::Light& light) {
  v1::Scene scene;
  v1::Mesh& mesh = *scene.mutable_object()->mutable_mesh();
  mesh.set_builtin(shape);
  v1::Rotation& turn = *mesh.add_transforms()->mutable_rotate();
  *turn.mutable_axis() = vec3(0, 1, 0);
  turn.set_angle_degrees(30);
  v1::Surface& ground = *scene.add_surfaces();
  *ground.mutable_rectangle()->mutable_half_u() = vec3(20, 0, 0);
  *ground.mutable_rectangle()->mutable_half_v() = vec3(0, 0, -20);
  ground.set_reflectance(0.3F);
  *scene.add_lights() = light;
  v1::Camera& camera = *scene.mutable_camera();
  *camera.mutable_origin() = vec3(0, 11, -32);
  *camera.mutable_target() = vec3(0, 0.42F, 0);
  camera.set_fov_degrees(3);
  scene.mutable_film()->set_width(kSide);
  scene.mutable_film()->set_height(kSide);
  return scene;
}

Panel panel_of(const std::vector<float>& image) {
  const float white = white_level(image);
  const size_t channels = image.size() / (kSide * kSide);
  Panel panel{.side = kSide, .pixels = {}};
  for (size_t p = 0; p < kSide * kSide; ++p) {
    const auto byte = [&](size_t c) { return to_srgb_byte(image[p * channels + c] / white); };
    panel.pixels.push_back({byte(0), byte(channels / 2), byte(channels - 1)});
  }
  return panel;
}

}  // namespace

std::vector<float> rerendered(JobRenderer& pool, v1::Scene scene, const PredictInput& photograph,
                              std::span<const Material> materials, uint32_t spp) {
  v1::Film& film = *scene.mutable_film();
  const double width = photograph.width, height = photograph.height;
  if (std::abs(film.width() * height - film.height() * width) > std::max(width, height)) {
    throw invalid_input(
        fmt::format("the film of the scene is {} x {} pixels, the photograph {} x {}; the scene "
                    "must show what the photograph shows, with sides of the same ratio",
                    film.width(), film.height(), photograph.width, photograph.height));
  }
  // The picture is as fine as the photograph, but no finer than twice what the network sees.
  const int side = photograph.photograph.side;
  const Square& square = photograph.photograph.square;
  const double scale = std::min(1.0, 2.0 * side / square.side);
  const auto scaled = [scale](double pixels) {
    return static_cast<int>(std::lround(scale * pixels));
  };
  film.set_width(static_cast<uint32_t>(scaled(width)));
  film.set_height(static_cast<uint32_t>(scaled(height)));
  const Square frame{scaled(square.left), scaled(square.top), std::max(side, scaled(square.side))};
  const double pixels_in_one = std::pow(static_cast<double>(frame.side) / side, 2);
  const double length = unposed_size("scene.object", scene.object());
  std::vector<Material> as_large(materials.begin(), materials.end());
  for (Material& material : as_large) material.sigma_t /= length;
  const auto samples = static_cast<uint32_t>(std::ceil(spp / pixels_in_one));
  const int film_width = static_cast<int>(film.width());
  return averaged(interleaved(submit(pool, std::move(scene), as_large, samples, v1::OBJECT_PIXELS)),
                  static_cast<int>(materials.size()), film_width, frame, side, interruption());
}

std::vector<Swatch> render_swatches(JobRenderer& pool, std::span<const Material> materials,
                                    uint32_t spp, const std::function<void()>& rendered) {
  std::vector<Swatch> swatches;
  std::vector<Channels> renders;
  for (const auto& [light, light_name] :
       {std::pair{sun_and_sky(), "sun and sky"}, std::pair{studio(), "soft boxes"}}) {
    for (const auto& [shape, shape_name] :
         {std::pair{"smooth_star", "Smooth star"}, std::pair{"cube", "Cube"}}) {
      swatches.push_back({shape_name, light_name, {}});
      renders.push_back(submit(pool, scene_of(shape, light), materials, spp, v1::ALL_PIXELS));
    }
  }
  for (size_t i = 0; i < swatches.size(); ++i) {
    swatches[i].picture = panel_of(interleaved(std::move(renders[i])));
    rendered();
  }
  return swatches;
}

}  // namespace itn
