#include "common/image/photograph.h"

#include <gmock/gmock.h>
#include <sys/resource.h>

#include <cmath>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using ::testing::Each;

struct Pixels {
  int width, height, channels;
  std::vector<float> values, mask;
  Photograph view() const { return {width, height, channels, values, mask}; }
};

// No two pixels are alike. The object is a rectangle.
Pixels picture(int width, int height, int channels, int left, int top, int right, int bottom) {
  Pixels p{width, height, channels, {}, {}};
  p.values.reserve(static_cast<size_t>(width) * height * channels);
  p.mask.reserve(static_cast<size_t>(width) * height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      p.mask.push_back(x >= left && x < right && y >= top && y < bottom ? 1.0F : 0.25F);
      for (int c = 0; c < channels; ++c) {
        p.values.push_back(
            static_cast<float>(2 + std::sin(0.3 * x + c) + std::cos(0.1 * y * (c + 1))));
      }
    }
  }
  return p;
}

// The same by its definition: the mean over a cell of what is black outside of the photograph.
double mean_over_cell(const Pixels& p, int channel, double left, double top, double side) {
  const auto overlap = [side](double low, int pixel) {
    return std::max(0.0, std::min(low + side, pixel + 1.0) - std::max<double>(low, pixel));
  };
  const auto first = [](double low) { return std::max(0, static_cast<int>(std::floor(low))); };
  double sum = 0;
  for (int y = first(top); y < std::min<double>(p.height, top + side); ++y) {
    for (int x = first(left); x < std::min<double>(p.width, left + side); ++x) {
      sum += overlap(left, x) * overlap(top, y) *
             p.values[(static_cast<size_t>(y) * p.width + x) * p.channels + channel];
    }
  }
  return sum / (side * side);
}

TEST(Photograph, ASquareOneIsTakenWhole) {
  const Pixels p = picture(64, 64, 3, 10, 10, 20, 20);
  const FramedPhotograph square = framed(p.view());
  EXPECT_EQ(square.side, 64);
  EXPECT_EQ(square.pixels, p.values);
  EXPECT_EQ(square.mask, p.mask);
}

TEST(Photograph, OfAnyOtherASquareAboutTheObjectIsCutOut) {
  const Pixels p = picture(120, 80, 3, 50, 30, 81, 60);  // 31 x 30 pixels: a square of 31 * 1.48
  const FramedPhotograph square = framed(p.view());
  ASSERT_EQ(square.side, 46);
  const int left = 50 - 7, top = 30 - 8;
  for (int y = 0; y < square.side; ++y) {
    for (int x = 0; x < square.side; ++x) {
      const size_t from = static_cast<size_t>(top + y) * p.width + left + x;
      const size_t to = static_cast<size_t>(y) * square.side + x;
      ASSERT_EQ(square.mask[to], p.mask[from]);
      for (size_t c = 0; c < 3; ++c) ASSERT_EQ(square.pixels[to * 3 + c], p.values[from * 3 + c]);
    }
  }
}

TEST(Photograph, ASquareOneIsFramedAboutTheObjectIfItShallBe) {
  const Pixels p = picture(120, 120, 1, 50, 30, 81, 60);
  EXPECT_EQ(frame(p.view()).side, 120);
  EXPECT_EQ(frame(p.view(), Framing::kObject).side, 46);
  const FramedPhotograph square = framed(p.view(), {}, Framing::kObject);
  ASSERT_EQ(square.side, 46);
  EXPECT_EQ(square.pixels.front(), p.values[(30 - 8) * 120 + 50 - 7]);
}

TEST(Photograph, KnowsWhetherTheObjectReachesItsEdge) {
  EXPECT_FALSE(reaches_edge(picture(40, 30, 1, 1, 1, 39, 29).view()));
  EXPECT_TRUE(reaches_edge(picture(40, 30, 1, 0, 1, 39, 29).view()));
  EXPECT_TRUE(reaches_edge(picture(40, 30, 1, 1, 0, 39, 29).view()));
  EXPECT_TRUE(reaches_edge(picture(40, 30, 1, 1, 1, 40, 29).view()));
  EXPECT_TRUE(reaches_edge(picture(40, 30, 1, 1, 1, 39, 30).view()));
}

TEST(Photograph, IsRefusedWhereTheObjectIsBlack) {
  Pixels p = picture(40, 30, 3, 10, 10, 20, 20);
  for (size_t i = 0; i < p.mask.size(); ++i) {
    if (is_on_object(p.mask[i])) {
      for (size_t c = 0; c < 3; ++c) p.values[3 * i + c] = 0;
    }
  }
  testing::expect_error(ErrorKind::kInvalidInput, {"the image is black wherever the mask"},
                        [&] { validate(p.view()); });
  p.values[(12 * 40 + 12) * 3 + 1] = 0.1F;
  EXPECT_NO_THROW(validate(p.view()));
}

TEST(Photograph, ALargeSquareIsAveragedOverAreasBlackOutside) {
  struct Row {
    Pixels p;
    double left, top, side;
  };
  const Row rows[] = {
      {picture(300, 300, 1, 0, 0, 9, 9), 0, 0, 300},                       // whole, not a multiple
      {picture(1024, 1024, 1, 0, 0, 9, 9), 0, 0, 1024},                    // whole, a multiple
      {picture(900, 600, 3, 300, 100, 600, 350), 228, 3, 444},             // inside
      {picture(500, 400, 1, 200, 20, 500, 400), 200 - 131, 20 - 91, 562},  // beyond the border
      {picture(900, 7, 1, 0, 0, 900, 7), -216, (7 - 1332) / 2, 1332.0},    // narrow
  };
  for (const Row& row : rows) {
    const FramedPhotograph square = framed(row.p.view());
    ASSERT_EQ(square.side, kMaxFrameSide);
    const double cell = row.side / kMaxFrameSide;
    for (int y = 0; y < square.side; ++y) {
      for (int x = 0; x < square.side; ++x) {
        for (int c = 0; c < row.p.channels; ++c) {
          const size_t i = (static_cast<size_t>(y) * square.side + x) * row.p.channels + c;
          ASSERT_NEAR(square.pixels[i],
                      mean_over_cell(row.p, c, row.left + x * cell, row.top + y * cell, cell), 2e-6)
              << row.side << " at " << x << ", " << y;
        }
      }
    }
  }
}

TEST(Photograph, WhatIsFramedStaysAsItIs) {
  for (const Pixels& p : {picture(700, 500, 3, 100, 100, 600, 400),  // averaged
                          picture(700, 500, 1, 600, 400, 700, 500),  // at the border
                          picture(400, 400, 1, 0, 0, 400, 400), picture(5, 3, 3, 1, 1, 2, 2)}) {
    const FramedPhotograph once = framed(p.view());
    const FramedPhotograph twice = framed(once.view());
    EXPECT_EQ(twice.side, once.side);
    EXPECT_EQ(twice.pixels, once.pixels);
    EXPECT_EQ(twice.mask, once.mask);
  }
}

TEST(Photograph, FramesInLittleMemoryWhateverTheShape) {
  const auto peak_megabytes = [] {
    rusage usage{};
    ::getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss / 1024;
  };
  const Pixels row = picture(16384, 1, 3, 0, 0, 16384, 1);
  const Pixels strip = picture(8192, 256, 1, 0, 0, 8192, 256);
  const auto before = peak_megabytes();
  for (const Pixels* p : {&row, &strip}) {
    const FramedPhotograph square = framed(p->view());
    EXPECT_EQ(square.side, kMaxFrameSide);
    EXPECT_THAT(std::span(square.mask).first(kMaxFrameSide), Each(0));  // above it
  }
  EXPECT_LT(peak_megabytes() - before, 32);
}

TEST(Photograph, StopsAtTheNextRow) {
  Pixels p = picture(16, 16, 1, 2, 2, 9, 9);
  p.values[20] = NAN;  // not looked at
  std::stop_source stop;
  stop.request_stop();
  testing::expect_error(ErrorKind::kCancelled, {"cancelled"},
                        [&] { validate(p.view(), stop.get_token()); });
  testing::expect_error(ErrorKind::kCancelled, {"cancelled"},
                        [&] { framed(p.view(), stop.get_token()); });
}

// Whatever the sides are, as 107 and 104, whose last border is rounded.
TEST(Averaged, KeepsTheMeanOfEverySize) {
  for (int pixels = 32; pixels <= 260; ++pixels) {
    const std::vector<float> ones(static_cast<size_t>(pixels) * static_cast<size_t>(pixels), 1);
    for (const int side : {pixels / 4 * 4, pixels - 1, pixels * 2 / 3, 30, 7}) {
      const std::vector<float> result = averaged(ones, 1, pixels, {0, 0, pixels}, side);
      ASSERT_EQ(result.size(), static_cast<size_t>(side) * static_cast<size_t>(side));
      for (const float value : result) ASSERT_NEAR(value, 1, 1e-5) << pixels << " to " << side;
    }
  }
}

}  // namespace
}  // namespace itn
