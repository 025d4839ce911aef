// A picture for people: input, re-rendering with the prediction, and their difference.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

namespace itn {

struct Comparison {
  std::vector<float> input;     // resolution x resolution
  std::vector<float> rendered;  // likewise
};

// One row for each comparison: input | re-rendering | signed difference. Input and re-rendering are
// shown in sRGB on a common scale, the 99th percentile of the input white. The difference is white
// where both agree, red where the re-rendering is brighter, blue where it is darker; full colour is
// half the level of white. Pixels are enlarged by a whole number to 256 pixels a side or more.
void write_comparison(const std::filesystem::path& path, int resolution,
                      std::span<const Comparison> rows);

}  // namespace itn
