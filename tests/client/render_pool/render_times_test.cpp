#include "client/render_pool/render_times.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

using namespace std::chrono_literals;

TEST(RenderTimes, ArePatientAsLongAsNothingIsKnown) {
  EXPECT_EQ(RenderTimes().straggler_after(), 5s);
}

TEST(RenderTimes, CallARenderLateByTheMedian) {
  RenderTimes times;
  for (const auto time : {1s, 1s, 2s, 3s, 100s}) times.add(time, 1000);
  EXPECT_EQ(times.straggler_after(), 8s);
}

TEST(RenderTimes, ForgetWhatIsLongAgo) {
  RenderTimes times;
  for (int i = 0; i < 100; ++i) times.add(1h, 1000);
  for (int i = 0; i < 64; ++i) times.add(1s, 1000);
  EXPECT_EQ(times.straggler_after(), 4s);
}

TEST(RenderTimes, DoNotHurryShortRenders) {
  RenderTimes times;
  times.add(1ms, 1000);
  EXPECT_EQ(times.straggler_after(), 100ms);
}

TEST(RenderTimes, SetNoDeadlineAsLongAsNothingIsKnown) {
  EXPECT_EQ(RenderTimes().deadline(1000), 0ms);
}

TEST(RenderTimes, SetADeadlineByTheSlowestRenderAndTheWork) {
  RenderTimes times;
  times.add(1s, 100);
  times.add(4s, 200);
  times.add(3s, 1000);
  EXPECT_EQ(times.deadline(1000), 600s);
  EXPECT_EQ(times.deadline(1), 30s);  // none is shorter
  EXPECT_EQ(times.deadline(1e12), 24h);
}

}  // namespace
}  // namespace itn
