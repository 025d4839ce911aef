#include "server/render/render_reply.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "common/error.h"
#include "common/rpc/wire_array.h"
#include "server/render/derivatives.h"
#include "server/render/rendering_loss.h"
#include "server/render/request_check.h"

namespace itn {
namespace {

void check_size(const char* what, size_t size, size_t expected) {
  if (size != expected) {
    throw Error(
        ErrorKind::kInternal,
        fmt::format("{} of the reply has the size {}; it should have {}", what, size, expected));
  }
}

template <typename T = int64_t>
std::vector<T> sums_from_bytes(const char* what, const std::string& bytes, size_t pixels) {
  check_size(what, bytes.size(), pixels * sizeof(T));
  return from_bytes<T>(bytes);
}

size_t pixel_count(const v1::RenderGradReply& reply) {
  return size_t{reply.width()} * reply.height();
}

// What was asked, of sums that have all that it is made of.
Derivatives derivatives_in(const tracer::FilmSums& sums, const v1::RenderGradRequest& request) {
  Derivatives derivatives = derivatives_of(request, build_material(request.material()));
  check_size("sums.derivative_quanta", sums.derivative_quanta.size(),
             derivatives.parameters.size());
  return derivatives;
}

// In double, as the terms may cancel; a zero weight leaves its image out, so that an asked
// coordinate is returned as it is.
std::vector<float> combine(const tracer::RenderedImages::Estimate& estimate,
                           const std::vector<double>& weights) {
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

// Of the image as it would be sent: 0 at the pixels that are not rendered.
void fill_loss(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
               v1::RenderGradReply& reply) {
  const RenderingLoss loss =
      rendering_loss(from_bytes<float>(request.loss().image()),
                     from_bytes<float>(request.loss().weight()), tracer::means(sums).estimates);
  reply.set_loss(loss.value);
  for (const std::vector<double>& weights : derivatives_in(sums, request).weights) {
    double sum = 0;
    for (size_t c = 0; c < weights.size(); ++c) sum += weights[c] * loss.gradient[c];
    reply.add_loss_gradient(sum);
  }
}

void fill_images(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
                 v1::RenderGradReply& reply) {
  const Derivatives derivatives = derivatives_in(sums, request);
  const tracer::RenderedImages images = tracer::means(sums);
  for (const auto& estimate : images.estimates) {
    v1::Estimate& proto = *reply.add_estimates();
    proto.set_radiance(to_bytes(estimate.radiance));
    for (const std::vector<double>& weights : derivatives.weights) {
      proto.add_derivatives(to_bytes(combine(estimate, weights)));
    }
    for (const std::vector<float>& radiance : estimate.at_albedos) {
      proto.add_at_albedos(to_bytes(radiance));
    }
  }
  reply.set_mask(to_bytes(images.mask));
  reply.set_standard_error(to_bytes(images.standard_error));
}

void fill_sums(const tracer::FilmSums& sums, v1::ExactSums& proto) {
  proto.set_quantum(sums.quantum);
  proto.set_squares_quantum(sums.squares_quantum);
  for (const double quantum : sums.derivative_quanta) proto.add_derivative_quanta(quantum);
  for (const auto& estimate : sums.estimates) {
    v1::EstimateSums& estimate_proto = *proto.add_estimates();
    estimate_proto.set_radiance(to_bytes(estimate.radiance));
    for (const auto& derivative : estimate.derivatives) {
      estimate_proto.add_derivatives(to_bytes(derivative));
    }
    for (const std::vector<int64_t>& radiance : estimate.at_albedos) {
      estimate_proto.add_at_albedos(to_bytes(radiance));
    }
    estimate_proto.set_counts(to_bytes(estimate.counts));
  }
  proto.set_squares(to_bytes(sums.squares));
  proto.set_hits(to_bytes(sums.hits));
  proto.set_first_sample(sums.first_sample);
  proto.set_sample_count(sums.sample_count);
}

}  // namespace

v1::RenderGradReply make_reply(const tracer::FilmSums& sums, const v1::RenderGradRequest& request) {
  v1::RenderGradReply reply;
  reply.set_width(static_cast<uint32_t>(sums.width));
  reply.set_height(static_cast<uint32_t>(sums.height));
  if (request.has_loss()) {
    fill_loss(sums, request, reply);
  } else if (request.exact_sums()) {
    fill_sums(sums, *reply.mutable_sums());
  } else {
    fill_images(sums, request, reply);
  }
  v1::Counters& counters = *reply.mutable_counters();
  counters.set_paths(sums.counters.paths);
  counters.set_steps(sums.counters.steps);
  counters.set_invalid_samples(sums.counters.invalid_samples);
  counters.set_leaks(sums.counters.leaks);
  counters.set_cpu_seconds(sums.counters.cpu_seconds);
  return reply;
}

tracer::FilmSums film_sums(const v1::RenderGradReply& reply) {
  const v1::ExactSums& proto = reply.sums();
  const size_t pixels = pixel_count(reply);
  tracer::FilmSums sums;
  sums.width = static_cast<int>(reply.width());
  sums.height = static_cast<int>(reply.height());
  sums.first_sample = proto.first_sample();
  sums.sample_count = proto.sample_count();
  sums.quantum = proto.quantum();
  sums.squares_quantum = proto.squares_quantum();
  sums.derivative_quanta.assign(proto.derivative_quanta().begin(), proto.derivative_quanta().end());
  for (const v1::EstimateSums& estimate : proto.estimates()) {
    auto& into = sums.estimates.emplace_back();
    into.radiance = sums_from_bytes("sums.estimates.radiance", estimate.radiance(), pixels);
    into.counts = sums_from_bytes<uint32_t>("sums.estimates.counts", estimate.counts(), pixels);
    for (const std::string& radiance : estimate.at_albedos()) {
      into.at_albedos.push_back(sums_from_bytes("sums.estimates.at_albedos", radiance, pixels));
    }
    check_size("sums.estimates.derivatives", estimate.derivatives_size(),
               proto.derivative_quanta_size());
    for (const std::string& derivative : estimate.derivatives()) {
      into.derivatives.push_back(sums_from_bytes("sums.estimates.derivatives", derivative, pixels));
    }
  }
  sums.squares = sums_from_bytes("sums.squares", proto.squares(), pixels);
  sums.hits = sums_from_bytes("sums.hits", proto.hits(), pixels);
  sums.counters = {reply.counters().paths(), reply.counters().steps(),
                   reply.counters().invalid_samples(), reply.counters().leaks(),
                   reply.counters().cpu_seconds()};
  return sums;
}

void check_reply(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request) {
  if (request.has_loss()) {
    check_size("loss_gradient", reply.loss_gradient_size(), request.derivatives_size());
    return;
  }
  const int estimates = static_cast<int>(std::max(request.estimates(), 1U));
  if (request.exact_sums()) {
    check_size("sums.estimates", reply.sums().estimates_size(), estimates);
    return;
  }
  const size_t bytes = pixel_count(reply) * sizeof(float);
  check_size("estimates", reply.estimates_size(), estimates);
  for (const v1::Estimate& estimate : reply.estimates()) {
    check_size("estimates.radiance", estimate.radiance().size(), bytes);
    check_size("estimates.derivatives", estimate.derivatives_size(), request.derivatives_size());
    for (const std::string& derivative : estimate.derivatives()) {
      check_size("estimates.derivatives", derivative.size(), bytes);
    }
    check_size("estimates.at_albedos", estimate.at_albedos_size(), request.albedos_size());
    for (const std::string& radiance : estimate.at_albedos()) {
      check_size("estimates.at_albedos", radiance.size(), bytes);
    }
  }
  check_size("mask", reply.mask().size(), bytes);
  check_size("standard_error", reply.standard_error().size(), bytes);
}

}  // namespace itn
