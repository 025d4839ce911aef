#include "client/render/render_job.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

namespace itn {

void set_value(v1::RenderGradRequest& request, const std::string& name, double value) {
  v1::NamedValue& set = *request.add_values();
  set.set_name(name);
  set.set_value(value);
}

std::string describe(const RenderJob& job) {
  std::vector<v1::Material> materials(job.request.colours().begin(), job.request.colours().end());
  if (materials.empty()) materials.push_back(job.request.material());
  std::vector<double> sigma_t, albedo;
  for (const v1::Material& material : materials) {
    sigma_t.push_back(material.sigma_t());
    albedo.push_back(material.albedo());
  }
  return fmt::format(
      "the render of scene {}, {} x {} pixels, {} spp, sigma_t {}, albedo {}, g {}, seed {}",
      to_hex(job.scene->digest.substr(0, 4)), job.scene->width, job.scene->height,
      job.request.spp(), fmt::join(sigma_t, "/"), fmt::join(albedo, "/"), materials[0].g(),
      job.request.seed());
}

}  // namespace itn
