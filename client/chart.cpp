#include "client/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "client/image/image.h"

namespace itn {
namespace {

constexpr int kWidth = 900, kHeight = 360;
// The margins of the chart's field within its picture.
constexpr int kLeft = 70, kRight = 20, kTop = 40, kBottom = 50;
constexpr int kLegendLine = 20;

// Okabe and Ito's, which people with colour blindness can tell apart.
constexpr std::array<std::array<int, 3>, 6> kCurveColours{
    {{0, 114, 178}, {213, 94, 0}, {0, 158, 115}, {204, 121, 167}, {230, 159, 0}, {86, 180, 233}}};

// How a curve is drawn: where colours come again, in dashes, then in dots.
struct Pen {
  explicit Pen(size_t curve) {
    const auto& [r, g, b] = kCurveColours[curve % kCurveColours.size()];
    colour = {static_cast<double>(r), static_cast<double>(g), static_cast<double>(b)};
    constexpr std::array<std::array<double, 2>, 3> kDashes{{{1, 1}, {7, 12}, {2, 5}}};
    const auto& [drawn, length] = kDashes[curve / kCurveColours.size() % kDashes.size()];
    dash = drawn;
    period = length;
  }

  cv::Scalar colour;
  double dash, period;  // pixels that are drawn, of so many along the curve
};

// Lines through points, dashed along all of them together.
void draw_line(const cv::Mat& picture, std::span<const cv::Point> points, const Pen& pen,
               int width) {
  double behind = 0;  // of the length of the curve
  for (size_t i = 1; i < points.size(); ++i) {
    const cv::Point2d from = points[i - 1], way = cv::Point2d(points[i]) - from;
    const double length = cv::norm(way);
    if (pen.dash == pen.period) {
      cv::line(picture, points[i - 1], points[i], pen.colour, width, cv::LINE_AA);
    } else {
      for (double dash = pen.period * std::floor(behind / pen.period); dash < behind + length;
           dash += pen.period) {
        const double begin = std::max(0.0, dash - behind);
        const double end = std::min(length, dash + pen.dash - behind);
        if (begin >= end) continue;
        cv::line(picture, from + way * (begin / length), from + way * (end / length), pen.colour,
                 width, cv::LINE_AA);
      }
    }
    behind += length;
  }
}

const cv::Scalar kBlack(0, 0, 0), kGray(225, 225, 225);

struct Range {
  double low, high;
};

// From the fraction `tail` of the values to 1 - `tail`, and a little more.
Range range_of(std::vector<double> values, double tail) {
  if (values.empty()) return {0, 1};
  std::ranges::sort(values);
  const auto at = [&](double part) {
    return values[static_cast<size_t>(part * static_cast<double>(values.size() - 1))];
  };
  const double low = at(tail), high = at(1 - tail);
  const double margin = high > low ? 0.05 * (high - low) : std::max(1e-9, 0.1 * std::abs(high));
  return {low - margin, high + margin};
}

struct Point {
  double x, y;  // y as it is drawn: its logarithm if the axis is logarithmic
};

std::vector<Point> points_of(const Chart& chart, const Curve& curve) {
  std::vector<Point> points;
  for (size_t i = 0; i < curve.x.size(); ++i) {
    const double y = chart.log_y ? std::log10(curve.y[i]) : curve.y[i];
    if (std::isfinite(curve.x[i]) && std::isfinite(y)) points.push_back({curve.x[i], y});
  }
  return points;
}

constexpr double kTextSize = 0.42;

int width_of(const std::string& text) {
  return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, kTextSize, 1, nullptr).width;
}

// Where the names of the curves begin, below the first line of the legend by `y`. The first line
// ends before the name of the axis.
std::vector<cv::Point> legend_places(const Chart& chart) {
  std::vector<cv::Point> places;
  cv::Point next(kLeft, 0);
  for (const Curve& curve : chart.curves) {
    const int end = kWidth - kRight - (next.y == 0 ? width_of(chart.x_name) + 24 : 0);
    if (next.x > kLeft && next.x + 24 + width_of(curve.name) > end) {
      next = {kLeft, next.y + kLegendLine};
    }
    places.push_back(next);
    next.x += width_of(curve.name) + 48;
  }
  return places;
}

// With all lines of its legend.
int height_of(const Chart& chart) {
  const std::vector<cv::Point> places = legend_places(chart);
  return kHeight + (places.empty() ? 0 : places.back().y);
}

class Field {
 public:
  Field(cv::Mat picture, const Range& x, const Range& y) : picture_(picture), x_(x), y_(y) {}

  cv::Point at(const Point& point) const {
    const auto part = [](double value, const Range& range) {
      return (value - range.low) / (range.high - range.low);
    };
    return {static_cast<int>(kLeft + part(point.x, x_) * (kWidth - kLeft - kRight)),
            static_cast<int>(kHeight - kBottom -
                             std::clamp(part(point.y, y_), 0.0, 1.0) * (kHeight - kTop - kBottom))};
  }

  void text(const std::string& words, const cv::Point& middle, double size = kTextSize) const {
    const cv::Size extent = cv::getTextSize(words, cv::FONT_HERSHEY_SIMPLEX, size, 1, nullptr);
    cv::putText(picture_, words, {middle.x - extent.width / 2, middle.y + extent.height / 2},
                cv::FONT_HERSHEY_SIMPLEX, size, kBlack, 1, cv::LINE_AA);
  }

  void axes(bool log_y) const {
    for (const double x : axis_marks(x_.low, x_.high, 8)) {
      const cv::Point foot = at({x, y_.low});
      cv::line(picture_, foot, at({x, y_.high}), kGray);
      text(fmt::format("{:g}", x), {foot.x, foot.y + 14});
    }
    for (const double y : axis_marks(y_.low, y_.high, 5)) {
      const cv::Point start = at({x_.low, y});
      cv::line(picture_, start, at({x_.high, y}), kGray);
      text(fmt::format("{:.3g}", log_y ? std::pow(10, y) : y), {start.x - 34, start.y});
    }
    cv::rectangle(picture_, at({x_.low, y_.high}), at({x_.high, y_.low}), kBlack);
  }

  void curve(const std::vector<Point>& points, const Pen& pen) const {
    std::vector<cv::Point> places;
    for (const Point& point : points) places.push_back(at(point));
    draw_line(picture_, places, pen, 1);
    if (points.size() == 1) cv::circle(picture_, places[0], 3, pen.colour, cv::FILLED, cv::LINE_AA);
  }

  void legend(const Chart& chart) const {
    const std::vector<cv::Point> places = legend_places(chart);
    for (size_t i = 0; i < chart.curves.size(); ++i) {
      const cv::Point start = places[i] + cv::Point(0, kHeight - 10);
      draw_line(picture_, std::array{start, start + cv::Point(18, 0)}, Pen(i), 2);
      const std::string& name = chart.curves[i].name;
      text(name, start + cv::Point(24 + width_of(name) / 2, 0));
    }
    text(chart.x_name, {kWidth - kRight - width_of(chart.x_name) / 2, kHeight - 10});
  }

 private:
  mutable cv::Mat picture_;  // OpenCV's handle: shared with the caller
  Range x_, y_;
};

void draw(const Chart& chart, const cv::Mat& picture) {
  std::vector<std::vector<Point>> curves;
  std::vector<double> x, y;
  for (const Curve& curve : chart.curves) {
    curves.push_back(points_of(chart, curve));
    for (const Point& point : curves.back()) {
      x.push_back(point.x);
      y.push_back(point.y);
    }
  }
  const Field field(picture, range_of(x, 0), range_of(y, 0.01));
  field.text(chart.title, {kWidth / 2, kTop / 2}, 0.55);
  field.axes(chart.log_y);
  for (size_t i = 0; i < curves.size(); ++i) field.curve(curves[i], Pen(i));
  field.legend(chart);
}

}  // namespace

std::vector<double> axis_marks(double low, double high, int count) {
  const double rough = (high - low) / count;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  const double ratio = rough / power;
  const double step = power * (ratio < 1.5 ? 1 : ratio < 3.5 ? 2 : ratio < 7.5 ? 5 : 10);
  std::vector<double> marks;
  for (double k = std::ceil(low / step); k * step <= high; ++k) {
    marks.push_back(k * step + 0.0);  // 0 is not written -0
  }
  return marks;
}

void write_charts(const std::filesystem::path& path, std::span<const Chart> charts) {
  int height = 0;
  for (const Chart& chart : charts) height += height_of(chart);
  cv::Mat picture(height, kWidth, CV_8UC3, cv::Scalar(255, 255, 255));
  int top = 0;
  for (const Chart& chart : charts) {
    draw(chart, picture.rowRange(top, top + height_of(chart)));
    top += height_of(chart);
  }
  write_png(path, kWidth, height, {picture.data, picture.total() * picture.elemSize()});
}

}  // namespace itn
