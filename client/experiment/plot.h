// Plots in a page, as SVG.
#pragma once

#include <string>
#include <vector>

namespace itn {

struct Series {
  std::string name;  // in the legend; empty: not in it
  std::vector<double> x, y;
};

struct Plot {
  std::string title, x_name, y_name;
  bool log_x = false, log_y = false;
  bool diagonal = false;  // x = y is drawn, both axes have one range
  bool points = false;    // rather than lines
  std::vector<Series> series;
};

// Values that are not finite, or not above 0 on a logarithmic axis, are left out. Colours and sizes
// are in plot_style(); `first_colour` is that of the first series.
std::string svg_plot(const Plot& plot, size_t first_colour = 0);

// Names beside their colours.
std::string plot_legend(const std::vector<std::string>& names);

std::string plot_style();

}  // namespace itn
