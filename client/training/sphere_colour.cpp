#include "client/training/sphere_colour.h"

#include <future>
#include <vector>

#include "client/render/render_query.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace {

constexpr uint32_t kSide = 16;  // in pixels

v1::Scene scene_of(const std::optional<v1::RoughDielectric>& boundary) {
  v1::Scene scene;
  v1::Object& object = *scene.mutable_object();
  object.mutable_mesh()->set_builtin("sphere");
  object.set_smooth_angle_degrees(30);
  if (boundary) *object.mutable_rough_dielectric() = *boundary;
  scene.add_lights()->mutable_constant()->set_radiance(1);
  v1::Camera& camera = *scene.mutable_camera();
  camera.mutable_origin()->set_y(0.5F);
  camera.mutable_origin()->set_z(-20);
  camera.mutable_target()->set_y(0.5F);
  camera.set_fov_degrees(3);
  scene.mutable_film()->set_width(kSide);
  scene.mutable_film()->set_height(kSide);
  return scene;
}

double mean_on_object(const Render& render) {
  double sum = 0, area = 0;
  const std::vector<float>& radiance = render.estimates.front().radiance;
  for (size_t p = 0; p < radiance.size(); ++p) {
    sum += static_cast<double>(render.mask[p]) * radiance[p];
    area += render.mask[p];
  }
  return sum / area;
}

}  // namespace

std::array<double, 3> sphere_colour(JobRenderer& pool, std::span<const Material> colours,
                                    const std::optional<v1::RoughDielectric>& boundary,
                                    uint32_t spp, uint64_t seed, std::stop_token stop) {
  const auto scene = serialize(scene_of(boundary));
  std::vector<std::future<v1::RenderGradReply>> renders;
  for (const Material& medium : colours) {
    renders.push_back(
        pool.submit(job_of({.scene = scene, .material = medium, .spp = spp, .seed = seed})));
  }
  std::array<double, 3> colour{};
  for (size_t c = 0; c < colour.size(); ++c) {
    colour[c] = mean_on_object(render_of(wait_for_render(renders.at(c), stop)));
  }
  return colour;
}

}  // namespace itn
