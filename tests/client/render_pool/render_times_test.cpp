#include "client/render_pool/render_times.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

using namespace std::chrono_literals;

TEST(RenderTimes, ArePatientAsLongAsNothingIsKnown) {
  EXPECT_EQ(RenderTimes().late_after(), 5s);
}

TEST(RenderTimes, CallARenderLateByTheMedian) {
  RenderTimes times;
  for (const auto time : {1s, 1s, 2s, 3s, 100s}) times.add(time, 1000);
  EXPECT_EQ(times.late_after(), 8s);
}

TEST(RenderTimes, ForgetWhatIsLongAgo) {
  RenderTimes times;
  for (int i = 0; i < 100; ++i) times.add(1h, 1000);
  for (int i = 0; i < 64; ++i) times.add(1s, 1000);
  EXPECT_EQ(times.late_after(), 4s);
}

TEST(RenderTimes, DoNotHurryShortRenders) {
  RenderTimes times;
  times.add(1ms, 1000);
  EXPECT_EQ(times.late_after(), 100ms);
}

}  // namespace
}  // namespace itn
