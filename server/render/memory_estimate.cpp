#include "server/render/memory_estimate.h"
#include "server/render/derivatives.h"

#include <algorithm>

namespace itn {
namespace {

// Planned samples of a pixel, its place among those of the object, its sampling weight.
constexpr uint64_t kPlanPerPixel = 64;

uint64_t sums_per_pixel(uint64_t estimates, uint64_t derivatives, uint64_t albedos) {
  return estimates * (sizeof(uint32_t) + sizeof(int64_t) * (1 + derivatives + albedos)) +
         2 * sizeof(int64_t);
}

}  // namespace

uint64_t film_memory(uint64_t pixels, const v1::RenderGradRequest& request,
                     const tracer::RenderRequest& asked, uint64_t map_pixels) {
  const uint64_t estimates = asked.estimates, albedos = asked.albedos.size();
  const bool is_gradient = request.has_gradient();
  const uint64_t derivatives = is_gradient ? 0 : asked.derivatives.size();
  const uint64_t sums = sums_per_pixel(estimates, derivatives, albedos);
  const auto images = [&](uint64_t derivative_images) {
    return sizeof(float) * (estimates * (1 + derivative_images + albedos) + 2);
  };
  uint64_t bytes = kPlanPerPixel + sums;
  if (asked.pilot_spp > 0) bytes += sums;
  bytes += images(derivatives) + 3 * sizeof(double);  // of which those of the reply are combined
  if (!request.has_loss()) bytes += 2 * images(derivative_images(request));
  // Its weights, and its factors.
  if (is_gradient) bytes += sizeof(float) * (2 + estimates);
  const uint64_t bytes_of_map_pixel = estimates * (sizeof(int64_t) + 3 * sizeof(float));
  return bytes * pixels + bytes_of_map_pixel * map_pixels;
}

}  // namespace itn
