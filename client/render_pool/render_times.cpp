#include "client/render_pool/render_times.h"

#include <algorithm>
#include <vector>

namespace itn {
namespace {

using Duration = std::chrono::steady_clock::duration;

constexpr size_t kRemembered = 64;
constexpr int kLateFactor = 4;
// Renders of a millisecond are not worth a second attempt for being four times as long.
constexpr Duration kLeast = std::chrono::milliseconds(100);
constexpr Duration kUnknown = std::chrono::seconds(5);

}  // namespace

void RenderTimes::add(Duration time) {
  latest_.push_back(time);
  if (latest_.size() > kRemembered) latest_.pop_front();
}

Duration RenderTimes::late_after() const {
  if (latest_.empty()) return kUnknown;
  std::vector<Duration> times(latest_.begin(), latest_.end());
  const auto middle = times.begin() + static_cast<ptrdiff_t>(times.size() / 2);
  std::nth_element(times.begin(), middle, times.end());
  return std::max(kLeast, kLateFactor * *middle);
}

}  // namespace itn
