// Renders in rounds, each with further samples of the same image, until that is good enough.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "client/render/render_job.h"
#include "itn/v1/render.pb.h"

namespace itn {

class JobRenderer;

// When to render no more: whatever comes first.
struct RenderGoal {
  double noise = 0;    // of the noisiest job (noise_on_object) is at most this; 0: whatever it is
  double seconds = 0;  // have passed, in the steps of the rounds; 0: however long it takes
  uint32_t spp = 0;    // samples per pixel are there
  // By which the samples of all rounds but the last can be divided.
  uint32_t estimates = 1;
};

struct RenderedSoFar {
  uint32_t spp = 0;
  double noise = 0;
  double seconds = 0;             // that have passed
  double seconds_per_sample = 0;  // in the last round
  int rounds = 0;                 // that are done
};

// The samples per pixel of the next round; 0: it is good enough. A round makes an image at most
// four times as long, as noise and speed are known roughly at first, and takes a quarter of the
// whole time and 4096 samples at most.
uint32_t next_round(const RenderGoal& goal, const RenderedSoFar& so_far);

// The root mean square of the standard error of the pixels that see the object, over their mean
// radiance; of all pixels if none sees it. 0 if they are dark.
double noise_on_object(const std::vector<float>& radiance, const std::vector<float>& standard_error,
                       const std::vector<float>& mask);

// Adds the images of further samples of the same request to a reply, which has `spp` by now. Not
// for losses and gradients.
void add_samples(const v1::RenderGradReply& further, uint32_t further_spp,
                 v1::RenderGradReply& reply, uint32_t spp);

// One reply for each job: that to a request of all samples, but for rounding of floats.
struct RoundsReply {
  std::vector<v1::RenderGradReply> replies;
  uint32_t spp = 0;
  bool interrupted = false;  // before the goal was reached
};

// If `progress` throws an Error of kCancelled and a round is done, that is what comes back.
// `progress(so_far, round, fraction)` is called as JobRenderer::render_split does, in each round of
// so many samples. Throws what that throws.
using RoundProgress =
    std::function<void(const RenderedSoFar& so_far, uint32_t round, double fraction)>;
RoundsReply render_rounds(JobRenderer& renderer, std::span<const RenderJob> jobs,
                          const RenderGoal& goal, std::chrono::steady_clock::time_point start,
                          const RoundProgress& progress);

}  // namespace itn
