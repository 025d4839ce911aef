#include "server/render/render_reply.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <string>

#include "common/error.h"
#include "common/scene/wire_array.h"
#include "server/render/weighted_image_loss.h"

namespace itn {
namespace {

// In double, as the terms may cancel; a zero weight leaves its image out, so that an asked
// coordinate is returned as it is.
std::vector<float> combine(const RenderEstimate& estimate, const std::vector<double>& weights) {
  std::vector<double> sum(estimate.radiance.size());
  for (size_t c = 0; c < weights.size(); ++c) {
    if (weights[c] == 0) continue;
    for (size_t i = 0; i < sum.size(); ++i) sum[i] += weights[c] * estimate.derivatives[c][i];
  }
  std::vector<float> image(sum.size());
  std::transform(sum.begin(), sum.end(), image.begin(),
                 [](double value) { return static_cast<float>(value); });
  return image;
}

double combined(std::span<const double> gradient, const std::vector<double>& weights) {
  double sum = 0;
  for (size_t c = 0; c < weights.size(); ++c) sum += weights[c] * gradient[c];
  return sum;
}

// Nothing that is not finite leaves the worker as an answer.
template <typename Number>
const Number& finite(const Number& number) {
  if (!std::isfinite(number)) {
    throw Error(ErrorKind::kInternal, "the render is not finite: a fault of this worker");
  }
  return number;
}

std::string image_bytes(const std::vector<float>& image) {
  std::ranges::for_each(image, finite<float>);
  return to_bytes(image);
}

// The loss of the image as it would be sent: 0 at the pixels that are not rendered.
void fill_loss(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
               const DerivativeWeights& derivative_weights, v1::RenderGradReply& reply) {
  const LossWithGradient loss = weighted_image_loss(from_bytes<float>(request.loss().image()),
                                                    from_bytes<float>(request.loss().weight()),
                                                    tracer::means(sums).estimates);
  reply.set_loss(finite(loss.value));
  for (const std::vector<double>& weights : derivative_weights) {
    reply.add_loss_gradient(finite(combined(loss.gradient, weights)));
  }
}

void fill_images(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
                 const DerivativeWeights& derivative_weights, v1::RenderGradReply& reply) {
  const tracer::RenderedImages images = tracer::means(sums);
  for (const auto& estimate : images.estimates) {
    v1::Estimate& proto = *reply.add_estimates();
    proto.set_radiance(image_bytes(estimate.radiance));
    for (const std::vector<double>& weights : derivative_weights) {
      if (request.has_gradient()) {
        proto.add_gradient(finite(combined(estimate.gradient, weights)));
      } else {
        proto.add_derivatives(image_bytes(combine(estimate, weights)));
      }
    }
    proto.set_light_gradient(image_bytes(estimate.map_gradient));
    proto.set_normal_gradient(image_bytes(estimate.normal_gradient));
    for (const std::vector<float>& radiance : estimate.other_media) {
      *(request.colours().empty() ? proto.add_at_albedos() : proto.add_colours()) =
          image_bytes(radiance);
    }
  }
  reply.set_mask(image_bytes(images.mask));
  reply.set_standard_error(image_bytes(images.standard_error));
  for (const std::vector<float>& errors : images.colour_standard_errors) {
    reply.add_colour_standard_errors(image_bytes(errors));
  }
}

}  // namespace

v1::RenderGradReply make_reply(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
                               const DerivativeWeights& derivative_weights) {
  v1::RenderGradReply reply;
  reply.set_width(static_cast<uint32_t>(sums.width));
  reply.set_height(static_cast<uint32_t>(sums.height));
  if (request.has_loss()) {
    fill_loss(sums, request, derivative_weights, reply);
  } else {
    fill_images(sums, request, derivative_weights, reply);
  }
  v1::Counters& counters = *reply.mutable_counters();
  counters.set_paths(sums.counters.paths);
  counters.set_steps(sums.counters.steps);
  counters.set_invalid_samples(sums.counters.invalid_samples);
  counters.set_leaks(sums.counters.leaks);
  counters.set_cpu_seconds(sums.counters.cpu_seconds);
  return reply;
}

}  // namespace itn
