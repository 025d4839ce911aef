#include "client/render_pool/render_rounds.h"

#include <algorithm>
#include <cmath>

#include "client/render_pool/render_pool.h"
#include "client/render_pool/reply_images.h"
#include "client/render_pool/tiles.h"
#include "common/rpc/wire_array.h"

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

// By the sums of squared deviations from the mean of all.
std::vector<float> standard_error_of_both(const v1::RenderGradReply& a, uint32_t n_a,
                                          const v1::RenderGradReply& b, uint32_t n_b) {
  const std::vector<float> mean_a = mean_radiance(a, n_a), mean_b = mean_radiance(b, n_b);
  const auto error_a = from_bytes<float>(a.standard_error());
  const auto error_b = from_bytes<float>(b.standard_error());
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

double noise_of(const v1::RenderGradReply& reply, uint32_t spp) {
  return noise_on_object(mean_radiance(reply, spp), from_bytes<float>(reply.standard_error()),
                         from_bytes<float>(reply.mask()));
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
    // As noise falls with the root of the samples; somewhat more, as it is known roughly.
    const double missing = so_far.spp * (1.05 * std::pow(so_far.noise / goal.noise, 2) - 1);
    round = std::min(round, std::max({missing, so_far.spp / 8.0, estimates}));
  }
  if (so_far.spp > 0 && goal.seconds > 0) {
    const double time = std::min(goal.seconds - so_far.seconds, goal.seconds / 4);
    round = std::min(round, time / so_far.seconds_per_sample);
    if (round < 1) return 0;
  }
  if (round >= left) return static_cast<uint32_t>(left);
  return static_cast<uint32_t>(std::floor(round / estimates) * estimates);
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
  reply.set_standard_error(to_bytes(standard_error_of_both(reply, spp, further, further_spp)));
  average(further.mask(), further_spp, *reply.mutable_mask(), spp);
  for (uint32_t k = 0; k < estimates; ++k) {
    const double n = tracer::samples_of_estimate(spp, k, estimates);
    const double further_n = tracer::samples_of_estimate(further_spp, k, estimates);
    v1::Estimate& to = *reply.mutable_estimates(static_cast<int>(k));
    const v1::Estimate& from = further.estimates(static_cast<int>(k));
    average(from.radiance(), further_n, *to.mutable_radiance(), n);
    for (int d = 0; d < to.derivatives_size(); ++d) {
      average(from.derivatives(d), further_n, *to.mutable_derivatives(d), n);
    }
    for (int a = 0; a < to.at_albedos_size(); ++a) {
      average(from.at_albedos(a), further_n, *to.mutable_at_albedos(a), n);
    }
  }
  add_counters(further.counters(), *reply.mutable_counters());
}

RoundsReply render_rounds(RenderPool& pool, std::span<const RenderJob> jobs, const RenderGoal& goal,
                          std::chrono::steady_clock::time_point start,
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
    std::vector<v1::RenderGradReply> replies =
        pool.render_split(round, [&](double fraction) { progress(so_far, spp, fraction); });
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
