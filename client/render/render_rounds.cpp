#include "client/render/render_rounds.h"

#include <algorithm>
#include <cmath>

#include "client/render/job_renderer.h"
#include "client/render/reply_images.h"
#include "client/render/tiles.h"
#include "common/error.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

constexpr uint32_t kFirstRound = 8;
constexpr double kLargestRound = 4096;  // workers may take no more at once

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// The mean of two images of `n` and `further_n` samples, into the first.
void average(const std::string& further, double further_n, std::string& image, double n) {
  const std::vector<float> b = from_bytes<float>(further);
  std::vector<float> a = from_bytes<float>(image);
  for (size_t i = 0; i < a.size(); ++i) {
    a[i] = static_cast<float>((double{a[i]} * n + double{b[i]} * further_n) / (n + further_n));
  }
  image = to_bytes(a);
}

using Images = google::protobuf::RepeatedPtrField<std::string>;

void average(const Images& further, double further_n, Images& images, double n) {
  for (int i = 0; i < images.size(); ++i) average(further[i], further_n, images[i], n);
}

// What is known of the mean radiance.
struct MeanWithError {
  std::vector<float> mean, error;
};

// By the sums of squared deviations from the mean of all.
std::vector<float> standard_error_of_both(const MeanWithError& a, uint32_t n_a,
                                          const MeanWithError& b, uint32_t n_b) {
  const auto& [mean_a, error_a] = a;
  const auto& [mean_b, error_b] = b;
  const auto squares = [](double error, double n) { return error * error * n * (n - 1); };
  const auto n = static_cast<double>(n_a + n_b);
  std::vector<float> errors(mean_a.size());
  for (size_t i = 0; i < errors.size(); ++i) {
    const double apart = double{mean_b[i]} - mean_a[i];
    const double sum =
        squares(error_a[i], n_a) + squares(error_b[i], n_b) + apart * apart * n_a * n_b / n;
    errors[i] = static_cast<float>(std::sqrt(sum / (n * (n - 1))));
  }
  return errors;
}

MeanWithError of_radiance(const v1::RenderGradReply& reply, uint32_t spp) {
  return {mean_radiance(reply, spp), from_bytes<float>(reply.standard_error())};
}
MeanWithError of_colour(const v1::RenderGradReply& reply, uint32_t spp, int c) {
  return {mean_of_estimates(
              reply, spp, [c](const auto& e) -> const auto& { return e.colours(c); }),
          from_bytes<float>(reply.colour_standard_errors(c))};
}

// The noise of the image, or of the noisiest colour.
double noise_of(const v1::RenderGradReply& reply, uint32_t spp) {
  const std::vector<float> mask = from_bytes<float>(reply.mask());
  const auto noise = [&](const MeanWithError& image) {
    return noise_on_object(image.mean, image.error, mask);
  };
  const int colours = reply.colour_standard_errors_size();
  double most = colours == 0 ? noise(of_radiance(reply, spp)) : 0;
  for (int c = 0; c < colours; ++c) most = std::max(most, noise(of_colour(reply, spp, c)));
  return most;
}

}  // namespace

uint32_t next_round(const RenderGoal& goal, const RenderedSoFar& so_far) {
  if (goal.noise <= 0 && goal.seconds <= 0) return goal.spp - so_far.spp;
  if (so_far.spp >= goal.spp) return 0;
  const double left = goal.spp - so_far.spp, estimates = goal.estimates;
  double round = so_far.spp == 0 ? std::max(kFirstRound, goal.estimates)
                                 : std::min(3.0 * so_far.spp, kLargestRound);
  if (so_far.spp > 0 && goal.noise > 0) {
    if (so_far.noise <= goal.noise) return 0;
    // Noise falls with the root of the samples; it is known roughly, so somewhat more are asked
    // for.
    const double missing = so_far.spp * (1.05 * std::pow(so_far.noise / goal.noise, 2) - 1);
    round = std::min(round, std::max({missing, so_far.spp / 8.0, estimates}));
  }
  if (so_far.spp > 0 && goal.seconds > 0) {
    const double time = std::min(goal.seconds - so_far.seconds, goal.seconds / 4);
    round = std::min(round, time / so_far.seconds_per_sample);
    if (round < 1) return 0;
  }
  // No round has fewer samples than estimates.
  const double whole = std::floor(round / estimates) * estimates;
  return static_cast<uint32_t>(left - whole < estimates ? left : whole);
}

double noise_on_object(const std::vector<float>& radiance, const std::vector<float>& standard_error,
                       const std::vector<float>& mask) {
  const bool seen = std::ranges::any_of(mask, [](float m) { return m > 0; });
  double weights = 0, sum = 0, squares = 0;
  for (size_t i = 0; i < radiance.size(); ++i) {
    const double weight = seen ? mask[i] : 1;
    weights += weight;
    sum += weight * radiance[i];
    squares += weight * standard_error[i] * standard_error[i];
  }
  return sum > 0 ? std::sqrt(squares * weights) / sum : 0;
}

void add_samples(const v1::RenderGradReply& further, uint32_t further_spp,
                 v1::RenderGradReply& reply, uint32_t spp) {
  const auto estimates = static_cast<uint32_t>(reply.estimates_size());
  reply.set_standard_error(to_bytes(standard_error_of_both(
      of_radiance(reply, spp), spp, of_radiance(further, further_spp), further_spp)));
  for (int c = 0; c < reply.colour_standard_errors_size(); ++c) {
    reply.set_colour_standard_errors(
        c, to_bytes(standard_error_of_both(of_colour(reply, spp, c), spp,
                                           of_colour(further, further_spp, c), further_spp)));
  }
  average(further.mask(), further_spp, *reply.mutable_mask(), spp);
  for (uint32_t k = 0; k < estimates; ++k) {
    const double n = samples_of_estimate(spp, k, estimates);
    const double further_n = samples_of_estimate(further_spp, k, estimates);
    v1::Estimate& estimate = *reply.mutable_estimates(static_cast<int>(k));
    const v1::Estimate& from = further.estimates(static_cast<int>(k));
    average(from.radiance(), further_n, *estimate.mutable_radiance(), n);
    average(from.derivatives(), further_n, *estimate.mutable_derivatives(), n);
    average(from.at_albedos(), further_n, *estimate.mutable_at_albedos(), n);
    average(from.colours(), further_n, *estimate.mutable_colours(), n);
  }
  add_counters(further.counters(), *reply.mutable_counters());
}

RoundsReply render_rounds(JobRenderer& renderer, std::span<const RenderJob> jobs,
                          const RenderGoal& goal, std::chrono::steady_clock::time_point start,
                          const RoundProgress& progress) {
  RoundsReply result;
  RenderedSoFar so_far;
  std::vector<RenderJob> round(jobs.begin(), jobs.end());
  while (const uint32_t spp = next_round(goal, so_far)) {
    for (RenderJob& job : round) {
      job.request.set_first_sample(so_far.spp);
      job.request.set_spp(spp);
    }
    const double before = seconds_since(start);
    std::vector<v1::RenderGradReply> replies;
    try {
      replies =
          renderer.render_split(round, [&](double fraction) { progress(so_far, spp, fraction); });
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kCancelled || so_far.spp == 0) throw;
      result.interrupted = true;
      break;
    }
    so_far.seconds = seconds_since(start);
    so_far.seconds_per_sample = (so_far.seconds - before) / spp;
    if (result.replies.empty()) {
      result.replies = std::move(replies);
    } else {
      for (size_t i = 0; i < replies.size(); ++i) {
        add_samples(replies[i], spp, result.replies[i], so_far.spp);
      }
    }
    so_far.spp += spp;
    ++so_far.rounds;
    if (so_far.spp >= goal.spp) break;
    so_far.noise = 0;
    for (const v1::RenderGradReply& reply : result.replies) {
      so_far.noise = std::max(so_far.noise, noise_of(reply, so_far.spp));
    }
  }
  result.spp = so_far.spp;
  return result;
}

}  // namespace itn
