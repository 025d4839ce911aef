#include "client/predict/report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <string_view>
#include <utility>

#include "client/page.h"
#include "client/panels.h"
#include "client/predict/answer_warnings.h"
#include "client/predict/exported.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using Channel = v1::Prediction::Channel;

// `kind`: its class in the style; `caption` is HTML.
std::string figure(const Panel& panel, std::string_view kind, std::string_view caption) {
  return html_figure(encode_png(panel), kind,
                     fmt::format(" width=\"{}\" height=\"{}\"", panel.side, panel.side), caption);
}

// --- Text ---

std::string number(double value, bool is_coefficient) {
  const std::string text =
      is_coefficient ? fmt::format("{:.4g}", value) : fmt::format("{:.3f}", value);
  return text.starts_with('-') ? "\u2212" + text.substr(1) : text;
}

// --- The head ---

std::string title_of(const Report& report) {
  if (report.prediction.combined()) {
    return fmt::format("Optical parameters from {} photographs", report.photographs.size());
  }
  const std::string& image = report.prediction.image();
  return "Optical parameters of " +
         (image == "-" ? "a photograph" : fs::path(image).filename().string());
}

std::string head_of(const Report& report) {
  return fmt::format(
      "<header><h1>{}</h1><p>The translucent material of the object, as seen by the model {}.</p>"
      "</header>\n",
      html_escaped(title_of(report)), html_escaped(report.prediction.model()));
}

// --- How far to trust it ---

std::string trust_of(const v1::Prediction& prediction) {
  const std::vector<Limit> limits = limits_of(prediction);
  const char* kind = limits.empty() ? "" : limits.front().is_grave ? " grave" : " care";
  std::string text = fmt::format("<section class=\"trust{}\"><h2>{}</h2>", kind,
                                 limits.empty()            ? "How far to trust it"
                                 : limits.front().is_grave ? "Do not trust this answer"
                                                           : "What limits the answer");
  if (limits.empty())
    return text + "<p>Nothing known to limit it but its intervals.</p></section>\n";
  text += "<ul>";
  for (const Limit& limit : limits) {
    text += fmt::format("<li{}>{}</li>", limit.is_grave ? " class=\"grave\"" : "",
                        html_escaped(limit.text));
  }
  return text + "</ul></section>\n";
}

// --- The photographs ---

constexpr size_t kNetworkView = 3;  // panels of network_view_panels(); others are of a scene
constexpr std::array<std::string_view, 5> kPanelNames = {
    "The photograph as framed", "The mask: the object, outlined",
    "The weight map: where the material shows most", "The scene rendered with the answer",
    "Difference: red where the render is brighter, blue where darker"};

// The section of a scene that shows what the photograph shows; empty without one.
std::string rerendering_of(const Report& report) {
  const PanelRow& panels = report.photographs.front().panels;
  if (panels.size() <= kNetworkView) return "";
  return "<section><h2>The photograph beside a render of the answer</h2>\n<div class=\"row\">\n" +
         figure(panels[0], "panel", "The photograph") +
         figure(panels[kNetworkView], "panel", kPanelNames[kNetworkView]) +
         figure(panels[kNetworkView + 1], "panel", kPanelNames[kNetworkView + 1]) +
         "</div></section>\n";
}

std::string photographs_of(const Report& report) {
  std::string text = "<section><h2>What the network saw</h2>\n";
  for (const ReportedPhotograph& photograph : report.photographs) {
    if (report.prediction.combined()) {
      text +=
          fmt::format("<p class=\"name\">{}</p>",
                      html_escaped(fs::path(photograph.prediction.image()).filename().string()));
    }
    text += "<div class=\"row\">\n";
    for (size_t i = 0; i < kNetworkView; ++i) {
      text += figure(photograph.panels[i], "panel", kPanelNames.at(i));
    }
    text += "</div>\n";
    if (!report.prediction.combined()) continue;
    text += "<ul class=\"soft\">";
    for (const Limit& limit : limits_of(photograph.prediction)) {
      text += fmt::format("<li>{}</li>", html_escaped(limit.text));
    }
    text += "</ul>\n";
  }
  return text + "</section>\n";
}

// --- The numbers ---

struct Parameter {
  std::string_view symbol, meaning;
  bool is_coefficient;  // per length, and shown on a logarithmic scale
  double (Channel::*best)() const;
  const v1::ParameterPosterior& (v1::MaterialPosterior::*posterior)() const;
  const v1::Interval& (v1::MaterialRange::*range)() const;  // null of what is derived
};

const std::array<Parameter, 5> kParameters = {{
    {"&sigma;<sub>t</sub>", "extinction coefficient", true, &Channel::sigma_t,
     &v1::MaterialPosterior::sigma_t, &v1::MaterialRange::sigma_t},
    {"Albedo", "of a single scattering", false, &Channel::albedo, &v1::MaterialPosterior::albedo,
     &v1::MaterialRange::albedo},
    {"g", "mean cosine of the scattering angle", false, &Channel::g, &v1::MaterialPosterior::g,
     &v1::MaterialRange::g},
    {"&sigma;<sub>a</sub>", "absorption coefficient", true, &Channel::sigma_a,
     &v1::MaterialPosterior::sigma_a, nullptr},
    {"&sigma;<sub>s</sub>", "scattering coefficient", true, &Channel::sigma_s,
     &v1::MaterialPosterior::sigma_s, nullptr},
}};

// A range of the model, on which bars are drawn.
struct Axis {
  double min, max;
  bool is_logarithmic;

  // In percent of its length; what is beyond is at the end.
  double at(double value) const {
    const auto along = [&](double v) { return is_logarithmic ? std::log(v) : v; };
    const double part =
        value > 0 || !is_logarithmic ? (along(value) - along(min)) / (along(max) - along(min)) : 0;
    return 100 * std::clamp(part, 0.0, 1.0);
  }
};

std::optional<Axis> axis_of(const Report& report, const Parameter& parameter) {
  if (!report.range || parameter.range == nullptr) return std::nullopt;
  const v1::Interval& range = ((*report.range).*parameter.range)();
  const double length = parameter.is_coefficient && report.prediction.has_object_size()
                            ? report.prediction.object_size()
                            : 1;
  return Axis{range.min() / length, range.max() / length, parameter.is_coefficient};
}

std::string bar(const Axis& axis, double low, double best, double high) {
  constexpr double kThin = 1.2;  // of the mark, in percent
  const double left = axis.at(low), width = std::max(axis.at(high) - left, kThin);
  const double mark = std::clamp(axis.at(best) - kThin / 2, 0.0, 100 - kThin);
  return fmt::format(
      "<svg viewBox=\"0 0 100 14\" preserveAspectRatio=\"none\" aria-hidden=\"true\">"
      "<rect class=\"track\" x=\"0\" y=\"5\" width=\"100\" height=\"4\"></rect>"
      "<rect class=\"span\" x=\"{:.2f}\" y=\"3\" width=\"{:.2f}\" height=\"8\"></rect>"
      "<rect class=\"mark\" x=\"{:.2f}\" y=\"0\" width=\"{}\" height=\"14\"></rect></svg>",
      left, width, mark, kThin);
}

// The class that gives a channel its colour.
std::string_view colour_of(const std::string& channel) {
  if (channel.ends_with('R')) return "c-R";
  if (channel.ends_with('G')) return "c-G";
  return channel.ends_with('B') ? "c-B" : "c-Y";
}

std::string row_of(const Channel& channel, const Parameter& parameter,
                   const std::optional<Axis>& axis) {
  const double best = (channel.*parameter.best)();
  std::string interval = "&ndash;", drawn;
  if (channel.has_posterior()) {
    const v1::ParameterPosterior& p = (channel.posterior().*parameter.posterior)();
    interval = fmt::format("{} to {}", number(p.low(), parameter.is_coefficient),
                           number(p.high(), parameter.is_coefficient));
    if (axis) drawn = bar(*axis, p.low(), best, p.high());
  } else if (axis) {
    drawn = bar(*axis, best, best, best);
  }
  const std::string_view colour = colour_of(channel.channel());
  return fmt::format(
      "<tr class=\"values\"><th scope=\"row\"><span class=\"dot {}\"></span>{}</th><td "
      "class=\"best\">{}</td>"
      "<td>{}</td><td class=\"bar {}\">{}</td></tr>\n",
      colour, html_escaped(channel.channel()), number(best, parameter.is_coefficient), interval,
      colour, drawn);
}

std::string_view unit_of(const v1::Prediction& prediction) {
  return prediction.has_object_size() ? "1/mm" : "1/length";
}

std::string rows_of(const Report& report, const Parameter& parameter) {
  const std::optional<Axis> axis = axis_of(report, parameter);
  std::string text = fmt::format(
      "<tbody><tr><th colspan=\"4\" scope=\"rowgroup\" class=\"parameter\"><b>{}</b> {}{}{}"
      "</th></tr>\n",
      parameter.symbol, parameter.meaning,
      parameter.is_coefficient ? fmt::format(", {}", unit_of(report.prediction)) : "",
      axis ? fmt::format(" <span class=\"soft\">range: {} to {}</span>",
                         number(axis->min, parameter.is_coefficient),
                         number(axis->max, parameter.is_coefficient))
           : "");
  for (const Channel& channel : report.prediction.channels()) {
    text += row_of(channel, parameter, axis);
  }
  return text + "</tbody>\n";
}

std::string units_of(const v1::Prediction& prediction) {
  return prediction.has_object_size()
             ? fmt::format(
                   "The object&#39;s longest side is {:.6g} mm, as was said; coefficients "
                   "are per millimetre.",
                   prediction.object_size())
             : "The object&#39;s size is not known: coefficients are per length of its longest "
               "side. Divide them by that length in mm to have them in 1/mm.";
}

std::string numbers_of(const Report& report) {
  std::string text = fmt::format(
      "<section><h2>Answer</h2><p>{}</p>\n<table><thead><tr><th scope=\"col\">Channel</th>"
      "<th scope=\"col\">Best guess</th><th scope=\"col\">90 % interval</th>"
      "<th scope=\"col\">{}</th></tr></thead>\n",
      units_of(report.prediction), report.range ? "In the model&#39;s range" : "");
  for (const Parameter& parameter : kParameters) text += rows_of(report, parameter);
  text += "</table>\n";
  if (report.range) {
    text +=
        "<p class=\"soft legend\">Bars span all that the model can answer, &sigma;<sub>t</sub> on "
        "a "
        "logarithmic scale: a bar that fills the range says that little is known.</p>\n";
  }
  return text + "</section>\n";
}

// --- How it looks ---

std::string swatches_of(const Report& report) {
  std::string text =
      "<section><h2>How the best guess looks</h2>\n<p class=\"soft\">Rendered on other objects "
      "with a longest side as long as the photographed one&#39;s; without "
      "gloss.</p><div class=\"row\">\n";
  for (const Swatch& swatch : report.swatches) {
    text += figure(swatch.picture, "swatch", fmt::format("{}, {}", swatch.shape, swatch.light));
  }
  return text + "</div></section>\n";
}

// --- For renderers ---

std::string exports_of(const Report& report) {
  std::string text = "<section><h2>For renderers</h2>\n";
  for (const ExportFormat& format : export_formats()) {
    text += fmt::format(
        "<details><summary><b>{}</b> <span>{}</span></summary><div class=\"snippet\">"
        "<button type=\"button\" hidden>Copy</button><pre>{}</pre></div></details>\n",
        html_escaped(format.name), html_escaped(format.description),
        html_escaped(exported(report.prediction, format, report.exports)));
  }
  return text + "</section>\n";
}

// --- The model ---

std::string model_of(const v1::Prediction& prediction) {
  const v1::ModelVersion& model = prediction.model_version();
  const auto entry = [](std::string_view name, const std::string& value) {
    return fmt::format("<dt>{}</dt><dd>{}</dd>", name, value);
  };
  return fmt::format(
      "<section><h2>Who answered</h2><dl>{}{}{}{}{}</dl></section>\n",
      entry("Model", html_escaped(model.name())),
      entry("Version", model.version().empty() ? "none was given" : html_escaped(model.version())),
      entry("Training", fmt::format("{} steps", model.step())),
      entry("Weights", fmt::format("SHA-256 <code>{}</code>", html_escaped(model.sha256()))),
      entry(prediction.combined() ? "Photographs" : "Photograph",
            html_escaped(prediction.image())));
}

}  // namespace

std::string report_page(const Report& report) {
  const std::string body = head_of(report) + trust_of(report.prediction) + rerendering_of(report) +
                           photographs_of(report) + numbers_of(report) + swatches_of(report) +
                           exports_of(report) + model_of(report.prediction);
  return html_page(title_of(report), body);
}

}  // namespace itn
