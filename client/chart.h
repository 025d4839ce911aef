// Line charts for people, as PNG.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace itn {

struct Curve {
  std::string name;          // in the legend
  std::vector<double> x, y;  // as many of each; points that are not finite are left out
};

struct Chart {
  std::string title;
  std::string x_name;
  bool log_y = false;  // points with y <= 0 are left out
  std::vector<Curve> curves;
};

// One chart above the other, 900 x 360 pixels each and 20 more for each further line of the legend,
// with axes and numbers at round values. From the seventh on curves are dashed, in the colours of
// the first six. The vertical axis shows the middle 98 % of the values, so that a few wild ones at
// the start hide nothing. ASCII alone. Throws Error (kIo).
void write_charts(const std::filesystem::path& path, std::span<const Chart> charts);

// Numbers at which an axis from `low` to `high` (low < high) is marked: 1, 2 or 5 times a power of
// ten apart, about `count` of them, in rising order.
std::vector<double> axis_marks(double low, double high, int count);

}  // namespace itn
