#include "client/render_pool/render_job.h"

#include <fmt/format.h>

namespace itn {

std::string describe(const RenderJob& job) {
  const v1::Material& material = job.request.material();
  return fmt::format(
      "the render of scene {}, {} x {} pixels, {} spp, sigma_t {}, albedo {}, g {}, seed {}",
      to_hex(job.scene->digest.substr(0, 4)), job.scene->width, job.scene->height,
      job.request.spp(), material.sigma_t(), material.albedo(), material.g(), job.request.seed());
}

}  // namespace itn
