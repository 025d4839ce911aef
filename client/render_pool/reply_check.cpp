#include "client/render_pool/reply_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "common/error.h"

namespace itn {
namespace {

Error wrong(const std::string& what) {
  return Error(ErrorKind::kInternal, "the reply cannot be right: " + what);
}

void check_number(const char* what, uint64_t number, uint64_t expected) {
  if (number != expected)
    throw wrong(fmt::format("{} is {} rather than {}", what, number, expected));
}

void check_finite(const char* what, double value) {
  if (!std::isfinite(value)) throw wrong(fmt::format("{} is {}", what, value));
}

// An image of float32 whose values are in [least, most], and not NaN.
void check_image(const char* what, const std::string& bytes, uint64_t pixels, float least,
                 float most) {
  check_number(fmt::format("the size of {}", what).c_str(), bytes.size(), pixels * sizeof(float));
  for (size_t at = 0; at < bytes.size(); at += sizeof(float)) {
    float value = 0;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    if (!(value >= least && value <= most)) {
      throw wrong(fmt::format("{} of pixel {} is {}", what, at / sizeof value, value));
    }
  }
}

constexpr float kMost = std::numeric_limits<float>::max();

void check_images(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request,
                  uint64_t pixels) {
  check_number("the number of estimates", reply.estimates_size(),
               std::max(request.estimates(), 1U));
  for (const v1::Estimate& estimate : reply.estimates()) {
    check_image("radiance", estimate.radiance(), pixels, -kMost, kMost);
    check_number("the number of derivatives", estimate.derivatives_size(),
                 request.derivatives_size());
    for (const std::string& image : estimate.derivatives()) {
      check_image("a derivative", image, pixels, -kMost, kMost);
    }
    check_number("the number of at_albedos", estimate.at_albedos_size(), request.albedos_size());
    for (const std::string& image : estimate.at_albedos()) {
      check_image("radiance at an albedo", image, pixels, -kMost, kMost);
    }
  }
  check_image("mask", reply.mask(), pixels, 0, 1);
  check_image("standard_error", reply.standard_error(), pixels, 0, kMost);
}

void check_sums(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request,
                uint64_t pixels) {
  const v1::ExactSums& sums = reply.sums();
  const uint64_t bytes = pixels * sizeof(int64_t);
  const auto check_quantum = [](double quantum) {
    check_finite("a quantum", quantum);
    if (!(quantum > 0)) throw wrong(fmt::format("a quantum is {}", quantum));
  };
  check_quantum(sums.quantum());
  check_quantum(sums.squares_quantum());
  for (const double quantum : sums.derivative_quanta()) check_quantum(quantum);
  check_number("the number of sums", sums.estimates_size(), std::max(request.estimates(), 1U));
  for (const v1::EstimateSums& estimate : sums.estimates()) {
    check_number("the size of radiance sums", estimate.radiance().size(), bytes);
    check_number("the number of derivative sums", estimate.derivatives_size(),
                 request.derivatives().empty() ? 0 : sums.derivative_quanta_size());
    for (const std::string& derivative : estimate.derivatives()) {
      check_number("the size of derivative sums", derivative.size(), bytes);
    }
    check_number("the number of sums at_albedos", estimate.at_albedos_size(),
                 request.albedos_size());
    for (const std::string& radiance : estimate.at_albedos()) {
      check_number("the size of sums at_albedos", radiance.size(), bytes);
    }
    check_number("the size of counts", estimate.counts().size(), pixels * sizeof(uint32_t));
  }
  check_number("the size of squares", sums.squares().size(), bytes);
  check_number("the size of hits", sums.hits().size(), bytes);
}

void check_loss(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request) {
  check_finite("the loss", reply.loss());
  check_number("the number of gradients", reply.loss_gradient_size(), request.derivatives_size());
  for (const double gradient : reply.loss_gradient()) check_finite("a gradient", gradient);
}

void check_counters(const v1::Counters& counters) {
  if (counters.invalid_samples() > counters.paths() || counters.leaks() > counters.paths()) {
    throw wrong(fmt::format("{} invalid samples and {} leaks of {} paths",
                            counters.invalid_samples(), counters.leaks(), counters.paths()));
  }
  check_finite("cpu_seconds", counters.cpu_seconds());
}

}  // namespace

void check_reply(const v1::RenderGradReply& reply, const RenderJob& job) {
  const uint64_t pixels = uint64_t{job.scene->width} * job.scene->height;
  check_number("width", reply.width(), job.scene->width);
  check_number("height", reply.height(), job.scene->height);
  if (job.request.has_loss()) {
    check_loss(reply, job.request);
  } else if (job.request.exact_sums()) {
    check_sums(reply, job.request, pixels);
  } else {
    check_images(reply, job.request, pixels);
  }
  check_counters(reply.counters());
}

}  // namespace itn
