#include "client/experiment/plot.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "client/chart.h"
#include "client/page/page.h"

namespace itn {
namespace {

constexpr double kWidth = 360, kHeight = 260;
constexpr double kLeft = 52, kRight = 10, kTop = 26, kBottom = 40;
constexpr size_t kMaxPoints = 400;  // of a series

// Okabe and Ito's, which people with colour blindness can tell apart.
constexpr std::array<const char*, 7> kCurveColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                      "#e69f00", "#56b4e9", "#8c8c8c"};

struct Axis {
  double low = HUGE_VAL, high = -HUGE_VAL;  // as drawn: of a logarithmic one exponents of 10
  bool is_logarithmic = false;

  double along(double value) const { return is_logarithmic ? std::log10(value) : value; }
  void include(double value) {
    const double at = along(value);
    if (!std::isfinite(at)) return;
    low = std::min(low, at);
    high = std::max(high, at);
  }
  void widen() {
    if (!(low <= high)) low = 0, high = 1;
    const double margin = high > low ? 0.03 * (high - low) : std::max(0.1 * std::abs(high), 1e-6);
    low -= margin;
    high += margin;
  }
  double part(double value) const { return (along(value) - low) / (high - low); }
};

// Where an axis is marked, as it is drawn: a logarithmic one at 1, 2 and 5 times powers of ten.
std::vector<double> marks_of(const Axis& axis, int count) {
  if (!axis.is_logarithmic) return axis_marks(axis.low, axis.high, count);
  std::vector<double> marks;
  for (double power = std::floor(axis.low); power <= axis.high; ++power) {
    for (const double digit : {1.0, 2.0, 5.0}) {
      const double at = power + std::log10(digit);
      if (axis.low <= at && at <= axis.high) marks.push_back(at);
    }
  }
  return marks;
}

std::string axes(const Plot& plot, const Axis& x, const Axis& y) {
  std::string text;
  const auto label = [](const Axis& axis, double at) {
    return axis.is_logarithmic ? fmt::format("{:.3g}", std::pow(10, at)) : fmt::format("{:g}", at);
  };
  for (const double at : marks_of(x, 5)) {
    const double px = kLeft + (at - x.low) / (x.high - x.low) * (kWidth - kLeft - kRight);
    text += fmt::format(
        "<line class=\"grid\" x1=\"{0:.1f}\" y1=\"{1}\" x2=\"{0:.1f}\" y2=\"{2}\"/><text "
        "x=\"{0:.1f}\" "
        "y=\"{3}\" text-anchor=\"middle\">{4}</text>",
        px, kTop, kHeight - kBottom, kHeight - kBottom + 14, label(x, at));
  }
  for (const double at : marks_of(y, 4)) {
    const double py =
        kHeight - kBottom - (at - y.low) / (y.high - y.low) * (kHeight - kTop - kBottom);
    text += fmt::format(
        "<line class=\"grid\" x1=\"{0}\" y1=\"{1:.1f}\" x2=\"{2}\" y2=\"{1:.1f}\"/><text x=\"{3}\" "
        "y=\"{4:.1f}\" text-anchor=\"end\">{5}</text>",
        kLeft, py, kWidth - kRight, kLeft - 5, py + 4, label(y, at));
  }
  text += fmt::format("<text class=\"title\" x=\"{}\" y=\"16\" text-anchor=\"middle\">{}</text>",
                      (kLeft + kWidth - kRight) / 2, escaped(plot.title));
  text += fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                      (kLeft + kWidth - kRight) / 2, kHeight - 8, escaped(plot.x_name));
  return text;
}

}  // namespace

std::string svg_plot(const Plot& plot, size_t first_colour) {
  Axis x{.is_logarithmic = plot.log_x}, y{.is_logarithmic = plot.log_y};
  for (const Series& series : plot.series) {
    for (const double value : series.x) x.include(value);
    for (const double value : series.y) y.include(value);
  }
  x.widen();
  y.widen();
  if (plot.diagonal) {
    x.low = y.low = std::min(x.low, y.low);
    x.high = y.high = std::max(x.high, y.high);
  }
  std::string text =
      fmt::format("<svg class=\"plot\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">",
                  kWidth, kHeight, escaped(plot.title));
  text += axes(plot, x, y);
  if (plot.diagonal) {
    text += fmt::format("<line class=\"diagonal\" x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\"/>", kLeft,
                        kHeight - kBottom, kWidth - kRight, kTop);
  }
  for (size_t s = 0; s < plot.series.size(); ++s) {
    const Series& series = plot.series[s];
    const char* colour = kCurveColours[(first_colour + s) % kCurveColours.size()];
    const size_t step = std::max<size_t>(1, (series.x.size() + kMaxPoints - 1) / kMaxPoints);
    std::string points;
    for (size_t i = 0; i < series.x.size(); i += step) {
      const double px = kLeft + x.part(series.x[i]) * (kWidth - kLeft - kRight);
      const double py = kHeight - kBottom - y.part(series.y[i]) * (kHeight - kTop - kBottom);
      if (!std::isfinite(px) || !std::isfinite(py)) continue;
      points += plot.points ? fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"1.6\"/>", px, py)
                            : fmt::format("{:.1f},{:.1f} ", px, py);
    }
    text += plot.points ? fmt::format("<g fill=\"{}\" fill-opacity=\".55\">{}</g>", colour, points)
                        : fmt::format("<polyline fill=\"none\" stroke=\"{}\" points=\"{}\"/>",
                                      colour, points);
  }
  return text + "</svg>\n";
}

std::string plot_legend(const std::vector<std::string>& names) {
  std::string text = "<p class=\"legend\">";
  for (size_t i = 0; i < names.size(); ++i) {
    text += fmt::format("<span><i style=\"background:{}\"></i>{}</span> ",
                        kCurveColours[i % kCurveColours.size()], escaped(names[i]));
  }
  return text + "</p>\n";
}

std::string plot_style() {
  return R"(
svg.plot { height: auto; font-size: 11px; }
.plot text { fill: var(--soft); } .plot .title { fill: var(--text); font-weight: 600; font-size: 12px; }
.plot .grid { stroke: var(--line); } .plot .diagonal { stroke: var(--soft); stroke-dasharray: 4 3; }
.plot polyline { stroke-width: 1.4; }
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(18rem, 100%), 1fr)); gap: .8rem; }
.legend { font-size: .85rem; } .legend span { margin-right: 1em; white-space: nowrap; }
.legend i { display: inline-block; width: .8em; height: .8em; border-radius: 50%; margin-right: .35em; }
)";
}

}  // namespace itn
