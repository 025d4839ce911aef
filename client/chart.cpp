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

// Okabe and Ito's, which people with colour blindness can tell apart.
constexpr std::array<std::array<int, 3>, 6> kCurveColours{
    {{0, 114, 178}, {213, 94, 0}, {0, 158, 115}, {204, 121, 167}, {230, 159, 0}, {86, 180, 233}}};

cv::Scalar colour_of(size_t curve) {
  const auto& [r, g, b] = kCurveColours[curve % kCurveColours.size()];
  return {static_cast<double>(r), static_cast<double>(g), static_cast<double>(b)};
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

  void text(const std::string& words, const cv::Point& middle, double size = 0.42) const {
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

  void curve(const std::vector<Point>& points, const cv::Scalar& colour) const {
    for (size_t i = 1; i < points.size(); ++i) {
      cv::line(picture_, at(points[i - 1]), at(points[i]), colour, 1, cv::LINE_AA);
    }
    if (points.size() == 1) cv::circle(picture_, at(points[0]), 3, colour, cv::FILLED, cv::LINE_AA);
  }

  void legend(const Chart& chart) const {
    int x = kLeft;
    for (size_t i = 0; i < chart.curves.size(); ++i) {
      const std::string& name = chart.curves[i].name;
      const cv::Size extent = cv::getTextSize(name, cv::FONT_HERSHEY_SIMPLEX, 0.42, 1, nullptr);
      cv::line(picture_, {x, kHeight - 10}, {x + 18, kHeight - 10}, colour_of(i), 2);
      text(name, {x + 24 + extent.width / 2, kHeight - 10});
      x += extent.width + 48;
    }
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
  for (size_t i = 0; i < curves.size(); ++i) field.curve(curves[i], colour_of(i));
  field.legend(chart);
  field.text(chart.x_name, {kWidth - 60, kHeight - 10});
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
  const int height = kHeight * static_cast<int>(charts.size());
  cv::Mat picture(height, kWidth, CV_8UC3, cv::Scalar(255, 255, 255));
  for (size_t i = 0; i < charts.size(); ++i) {
    draw(charts[i],
         picture.rowRange(static_cast<int>(i) * kHeight, static_cast<int>(i + 1) * kHeight));
  }
  write_png(path, kWidth, height, {picture.data, picture.total() * picture.elemSize()});
}

}  // namespace itn
