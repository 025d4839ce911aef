#include "client/render_pool/render_times.h"

#include <algorithm>
#include <vector>

namespace itn {
namespace {

using Duration = std::chrono::steady_clock::duration;

constexpr size_t kRemembered = 64;
constexpr int kLateFactor = 4;
// Renders of a millisecond are not worth a second attempt for being four times as long.
constexpr Duration kMinTime = std::chrono::milliseconds(100);

// Scenes and materials of one training differ in cost by less than that, and who shares a worker
// with others waits in its queue for less.
constexpr double kDeadlineFactor = 30;
constexpr double kMinDeadlineSeconds = 30;
constexpr double kMaxDeadlineSeconds = 24 * 3600;

}  // namespace

void RenderTimes::add(Duration time, double samples) {
  latest_.push_back({time, std::chrono::duration<double>(time).count() / std::max(samples, 1.0)});
  if (latest_.size() > kRemembered) latest_.pop_front();
  std::vector<Duration> times;
  for (const Render& render : latest_) times.push_back(render.time);
  const auto middle = times.begin() + static_cast<ptrdiff_t>(times.size() / 2);
  std::nth_element(times.begin(), middle, times.end());
  straggler_after_ = std::max(kMinTime, kLateFactor * *middle);
}

std::chrono::milliseconds RenderTimes::deadline(double samples) const {
  if (latest_.empty()) return {};
  const auto slowest = std::ranges::max_element(latest_, {}, &Render::seconds_per_sample);
  const double seconds = std::clamp(kDeadlineFactor * slowest->seconds_per_sample * samples,
                                    kMinDeadlineSeconds, kMaxDeadlineSeconds);
  return std::chrono::milliseconds(static_cast<int64_t>(1000 * seconds));
}

}  // namespace itn
