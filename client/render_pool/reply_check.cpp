#include "client/render_pool/reply_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "client/render/tiles.h"
#include "common/error.h"
#include "common/scene/derivative_count.h"

namespace itn {
namespace {

Error bad_reply(const std::string& what) {
  return Error(ErrorKind::kInternal, "the reply cannot be right: " + what);
}

void check_number(const char* what, uint64_t number, uint64_t expected) {
  if (number != expected)
    throw bad_reply(fmt::format("{} is {} rather than {}", what, number, expected));
}

void check_finite(const char* what, double value) {
  if (!std::isfinite(value)) throw bad_reply(fmt::format("{} is {}", what, value));
}

// An image of float32 whose values are in [least, most], and not NaN.
void check_image(const char* what, const std::string& bytes, uint64_t pixels, float least,
                 float most) {
  check_number(fmt::format("the size of {}", what).c_str(), bytes.size(), pixels * sizeof(float));
  for (size_t at = 0; at < bytes.size(); at += sizeof(float)) {
    float value = 0;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    if (!(value >= least && value <= most)) {
      throw bad_reply(fmt::format("{} of pixel {} is {}", what, at / sizeof value, value));
    }
  }
}

// Of finite float32, if they are asked for; else empty.
void check_numbers(const char* what, const std::string& bytes, bool asked) {
  if (bytes.empty() == asked || bytes.size() % sizeof(float) != 0) {
    throw bad_reply(fmt::format("{} has {} bytes", what, bytes.size()));
  }
  for (size_t at = 0; at < bytes.size(); at += sizeof(float)) {
    float value = 0;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    check_finite(what, value);
  }
}

constexpr float kMaxValue = std::numeric_limits<float>::max();

void check_images(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request,
                  uint64_t pixels) {
  check_number("the number of estimates", reply.estimates_size(),
               std::max(request.estimates(), 1U));
  for (const v1::Estimate& estimate : reply.estimates()) {
    check_image("radiance", estimate.radiance(), pixels, 0, kMaxValue);
    check_number("the number of derivatives", estimate.derivatives_size(),
                 static_cast<int>(derivative_images(request)));
    for (const std::string& image : estimate.derivatives()) {
      check_image("a derivative", image, pixels, -kMaxValue, kMaxValue);
    }
    check_number("the number of gradients", estimate.gradient_size(),
                 request.has_gradient() ? derivative_count(request) : 0);
    for (const double gradient : estimate.gradient()) check_finite("a gradient", gradient);
    check_numbers("light_gradient", estimate.light_gradient(), request.gradient().has_light());
    check_numbers("normal_gradient", estimate.normal_gradient(), request.gradient().normals());
    check_number("the number of at_albedos", estimate.at_albedos_size(), request.albedos_size());
    for (const std::string& image : estimate.at_albedos()) {
      check_image("radiance at an albedo", image, pixels, 0, kMaxValue);
    }
    check_number("the number of colours", estimate.colours_size(), request.colours_size());
    for (const std::string& image : estimate.colours()) {
      check_image("radiance in a colour", image, pixels, 0, kMaxValue);
    }
  }
  check_image("mask", reply.mask(), pixels, 0, 1);
  check_image("standard_error", reply.standard_error(), pixels, 0, kMaxValue);
  check_number("the number of colour_standard_errors", reply.colour_standard_errors_size(),
               request.colours_size());
  for (const std::string& image : reply.colour_standard_errors()) {
    check_image("a standard error of a colour", image, pixels, 0, kMaxValue);
  }
}

void check_loss(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request) {
  check_finite("the loss", reply.loss());
  check_number("the number of gradients", reply.loss_gradient_size(), derivative_count(request));
  for (const double gradient : reply.loss_gradient()) check_finite("a gradient", gradient);
}

void check_counters(const v1::Counters& counters) {
  if (counters.invalid_samples() > counters.paths() || counters.leaks() > counters.paths()) {
    throw bad_reply(fmt::format("{} invalid samples and {} leaks of {} paths",
                                counters.invalid_samples(), counters.leaks(), counters.paths()));
  }
  check_finite("cpu_seconds", counters.cpu_seconds());
}

}  // namespace

void check_reply(const v1::RenderGradReply& reply, const RenderJob& job) {
  const v1::Tile tile = pixels_of(job);
  check_number("width", reply.width(), tile.width());
  check_number("height", reply.height(), tile.height());
  if (job.request.has_loss()) {
    check_loss(reply, job.request);
  } else {
    check_images(reply, job.request, uint64_t{tile.width()} * tile.height());
  }
  check_counters(reply.counters());
}

}  // namespace itn
