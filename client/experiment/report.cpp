#include "client/experiment/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <google/protobuf/util/json_util.h>

#include "client/experiment/colours.h"
#include "client/experiment/experiment_config.h"
#include "client/experiment/plot.h"
#include "client/page/page.h"
#include "client/panels.h"
#include "common/error.h"
#include "common/image/preview.h"
#include "common/progress.h"
#include "common/scene/text_proto.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

std::string section(const std::string& title, const std::string& body) {
  return fmt::format("<section><h2>{}</h2>\n{}</section>\n", escaped(title), body);
}

std::string note(const std::string& text) {
  return fmt::format("<p class=\"soft\">{}</p>\n", escaped(text));
}

std::string duration(double seconds) {
  return seconds < 10 ? fmt::format("{:.1f} s", seconds)
                      : format_duration(std::chrono::seconds(std::llround(seconds)));
}

// --- Tables ---

// The best of the networks in each column.
std::vector<double> best_of(const Table& table) {
  std::vector<double> best(table.columns.size(), HUGE_VAL);
  for (const Row& row : table.rows) {
    if (row.is_published || row.is_yardstick) continue;
    for (size_t c = 0; c < best.size(); ++c) {
      if (row.cells[c]) best[c] = std::min(best[c], row.cells[c]->value);
    }
  }
  return best;
}

std::string html_of(const Cell& cell, const Column& column, bool is_best) {
  std::string text = fmt::format("{:.{}f}", cell.value, column.decimals);
  if (is_best) text = "<b>" + text + "</b>";
  if (cell.low && cell.high) {
    text += fmt::format("<small>{:.{}f}&ndash;{:.{}f}</small>", *cell.low, column.decimals,
                        *cell.high, column.decimals);
  }
  return text;
}

std::string html_of(const Table& table) {
  const std::vector<double> best = best_of(table);
  std::string text = note(table.caption);
  text += "<div class=\"wide\"><table class=\"numbers\"><thead><tr><th></th>";
  for (const Column& column : table.columns) {
    text += fmt::format("<th scope=\"col\">{}{}</th>", escaped(column.name),
                        column.unit.empty() ? "" : fmt::format("<br>{}", escaped(column.unit)));
  }
  text += "</tr></thead><tbody>\n";
  for (const Row& row : table.rows) {
    text += fmt::format("<tr class=\"{}\"><th scope=\"row\">{}</th>",
                        row.is_published   ? "published"
                        : row.is_yardstick ? "yardstick"
                                           : "network",
                        escaped(row.name));
    for (size_t c = 0; c < table.columns.size(); ++c) {
      const std::optional<Cell>& cell = row.cells[c];
      const bool is_best = table.columns[c].is_error && !row.is_published && !row.is_yardstick &&
                           cell && cell->value == best[c];
      text +=
          fmt::format("<td>{}</td>", cell ? html_of(*cell, table.columns[c], is_best) : "&ndash;");
    }
    text += "</tr>\n";
  }
  text += "</tbody></table></div>\n";
  if (std::ranges::any_of(table.rows, &Row::is_published)) {
    text += note(
        "Published: Che et al., ICCP 2020, on their own shapes, lights and noise; not to be "
        "compared number by number with ours.");
  }
  return section(table.title, text);
}

// --- Pictures: as Figs. 5 and 6 of the paper ---

Panel gray_panel(const std::vector<float>& radiance, int side, float white) {
  Panel panel{.side = side, .pixels = {}};
  for (const float value : radiance) panel.pixels.push_back(gray(value / white));
  return panel;
}

Panel difference_panel(const std::vector<float>& radiance, const std::vector<float>& truth,
                       int side, float white) {
  Panel panel{.side = side, .pixels = {}};
  for (size_t p = 0; p < radiance.size(); ++p) {
    panel.pixels.push_back(diverging((radiance[p] - truth[p]) / white));
  }
  return panel;
}

std::string material_text(const Material& m) {
  return fmt::format("{:.0f}, {:.2f}, {:.2f}", m.sigma_t, m.albedo, m.g);
}

std::string montage(const StudyReport& report, StudyScene scene) {
  const int side = report.images.resolution();
  std::string text;
  for (const size_t k : report.images.shown()) {
    const uint32_t item = report.images.chosen()[k];
    const std::vector<float> truth = report.images.reference(scene, k);
    const float white = white_level(truth);
    std::string images = figure(gray_panel(truth, side, white), "panel",
                                "truth<br>" + material_text(report.test.truth[item]));
    std::string differences = "<figure class=\"panel\"></figure>";
    for (const Candidate& candidate : report.candidates) {
      if (candidate.kind != Candidate::Kind::kNetwork) continue;
      const std::vector<float> picture =
          report.images.picture(file_name_of(candidate.name), scene, k);
      images +=
          figure(gray_panel(picture, side, white), "panel",
                 escaped(candidate.name) + "<br>" + material_text(candidate.as_trained[item]));
      differences += figure(difference_panel(picture, truth, side, white), "panel", "");
    }
    text += fmt::format(
        "<div class=\"wide\"><div class=\"strip\">{}</div><div class=\"strip\">{}</div></div>\n",
        images, differences);
  }
  return text;
}

Panel colour_panel(const ColourPicture& picture, int side, float white) {
  Panel panel{.side = side, .pixels = std::vector<Rgb>(picture[0].size())};
  for (size_t p = 0; p < panel.pixels.size(); ++p) {
    for (size_t colour = 0; colour < kColours; ++colour) {
      panel.pixels[p][colour] = gray(picture[colour][p] / white)[colour];
    }
  }
  return panel;
}

// All colours on one scale.
float white_level_of(const ColourPicture& picture) {
  float white = 0;
  for (const std::vector<float>& plane : picture) white = std::max(white, white_level(plane));
  return white;
}

std::string colours_of(const StudyReport& report) {
  const int side = report.colours.resolution();
  const size_t count = static_cast<size_t>(report.colours.manifest().items_size()) / kColours;
  std::string text;
  for (size_t k = 0; k < count; ++k) {
    const ColourPicture input = input_colours(report.colours, k);
    const float white = white_level_of(input);
    std::string strip = figure(colour_panel(input, side, white), "panel", "input");
    for (const ReportedNetwork& network : report.networks) {
      const ColourPicture picture = read_colours(report.pictures, file_name_of(network.name), k);
      strip += figure(colour_panel(picture, side, white), "panel", escaped(network.name));
    }
    text += fmt::format("<div class=\"wide\"><div class=\"strip\">{}</div></div>\n", strip);
  }
  return section(
      "In colour",
      note("Red, green and blue are three materials in one scene. Each is read off a gray "
           "image by itself and rendered again.") +
          text);
}

// --- Training ---

std::vector<v1::TrainingMetrics> metrics_in(const fs::path& path) {
  std::vector<v1::TrainingMetrics> metrics;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    v1::TrainingMetrics& step = metrics.emplace_back();
    if (!google::protobuf::util::JsonStringToMessage(line, &step).ok()) metrics.pop_back();
  }
  return metrics;
}

std::string training_of(const StudyReport& report) {
  Plot regression{.title = "Distance to the truth (training)",
                  .x_name = "steps",
                  .y_name = "",
                  .log_y = true,
                  .series = {}};
  Plot validation{.title = "Validation error over the constant's",
                  .x_name = "steps",
                  .y_name = "",
                  .series = {}};
  Plot image{.title = "Image term (training)",
             .x_name = "steps",
             .y_name = "",
             .log_y = true,
             .series = {}};
  std::vector<std::string> names;
  for (const ReportedNetwork& network : report.networks) {
    names.push_back(network.name);
    Series r, v, i;
    double before = 0;
    for (const fs::path& path : {network.shared_metrics, network.metrics}) {
      if (path.empty()) continue;
      const std::vector<v1::TrainingMetrics> metrics = metrics_in(path);
      // Means of so many steps are one point.
      const size_t block = std::max<size_t>(1, metrics.size() / 80);
      double regression_sum = 0, image_sum = 0;
      for (size_t s = 0; s < metrics.size(); ++s) {
        const double step = before + metrics[s].step();
        regression_sum += metrics[s].regression_loss();
        image_sum += metrics[s].image_loss();
        if ((s + 1) % block == 0) {
          r.x.push_back(step);
          r.y.push_back(regression_sum / static_cast<double>(block));
          if (metrics[s].has_image_loss()) {
            i.x.push_back(step);
            i.y.push_back(image_sum / static_cast<double>(block));
          }
          regression_sum = image_sum = 0;
        }
        if (metrics[s].has_validation()) {
          const v1::ValidationMetrics& m = metrics[s].validation();
          v.x.push_back(step);
          v.y.push_back((m.sigma_t() + m.albedo() + m.g()) / 3);
        }
      }
      if (!metrics.empty()) before += metrics.back().step();
    }
    regression.series.push_back(std::move(r));
    validation.series.push_back(std::move(v));
    image.series.push_back(std::move(i));
  }
  return section("Training", plot_legend(names) + "<div class=\"plots\">" + svg_plot(regression) +
                                 svg_plot(validation) + svg_plot(image) + "</div>");
}

// --- Predicted against true ---

std::string scatter_of(const StudyReport& report) {
  struct Parameter {
    const char* name;
    bool is_logarithmic;
    double (*of)(const Material&);
  };
  constexpr std::array<Parameter, 3> kParameters = {
      {{"sigma_t", true, [](const Material& m) { return m.sigma_t; }},
       {"albedo", false, [](const Material& m) { return m.albedo; }},
       {"g", false, [](const Material& m) { return m.g; }}}};
  std::string text =
      note("Each point is an image of the test: the truth to the right, the prediction upwards.");
  size_t colour = 0;
  for (const Candidate& candidate : report.candidates) {
    if (candidate.kind != Candidate::Kind::kNetwork) continue;
    text += fmt::format("<p class=\"name\">{}</p><div class=\"plots\">", escaped(candidate.name));
    for (const Parameter& parameter : kParameters) {
      Series series;
      for (size_t i = 0; i < report.test.truth.size(); ++i) {
        series.x.push_back(parameter.of(report.test.truth[i]));
        series.y.push_back(parameter.of(candidate.as_trained[i]));
      }
      text += svg_plot({.title = parameter.name,
                        .x_name = "truth",
                        .y_name = "",
                        .log_x = parameter.is_logarithmic,
                        .log_y = parameter.is_logarithmic,
                        .diagonal = true,
                        .points = true,
                        .series = {series}},
                       colour);
    }
    ++colour;
    text += "</div>\n";
  }
  return section("Predicted against true", text);
}

// --- Analysis by synthesis ---

// How Table 3 goes on, as Fig. 7 of the paper.
std::string trajectories_of(const StudyReport& report) {
  const auto table = std::ranges::find(report.tables, "table_3", &Table::file);
  if (table == report.tables.end()) return {};
  const v1::AnalysisBySynthesis& settings = report.experiment.refinement();
  Plot adam{.title = "Adam: error over the constant's",
            .x_name = "iteration",
            .y_name = "",
            .series = {}};
  Plot newton{.title = "Gauss-Newton: error over the constant's",
              .x_name = "iteration",
              .y_name = "",
              .series = {}};
  std::vector<std::string> names;
  for (const Row& row : table->rows) {
    names.push_back(row.name);
    Series& a = adam.series.emplace_back();
    Series& n = newton.series.emplace_back();
    size_t cell = 0;
    for (const uint32_t iteration : settings.iterations()) {
      a.x.push_back(iteration);
      a.y.push_back(row.cells[cell++]->value);
    }
    for (const uint32_t iteration : settings.gauss_newton_iterations()) {
      n.x.push_back(iteration);
      n.y.push_back(row.cells[cell++]->value);
    }
  }
  return section(
      "Refinement, iteration by iteration",
      plot_legend(names) + "<div class=\"plots\">" + svg_plot(adam) + svg_plot(newton) + "</div>");
}

// --- Stated uncertainties ---

std::string calibration_of(const StudyReport& report) {
  std::string rows;
  for (const ReportedNetwork& network : report.networks) {
    const auto& estimates = network.predictions.as_trained();
    if (estimates.empty() || !estimates.Get(0).has_sigma_t()) continue;
    std::array<double, 3> inside{};
    for (int i = 0; i < estimates.size(); ++i) {
      const Material& truth = report.test.truth[static_cast<size_t>(i)];
      const auto holds = [](const v1::Interval& interval, double value) {
        return interval.min() <= value && value <= interval.max() ? 1.0 : 0.0;
      };
      inside[0] += holds(estimates[i].sigma_t(), truth.sigma_t);
      inside[1] += holds(estimates[i].albedo(), truth.albedo);
      inside[2] += holds(estimates[i].g(), truth.g);
    }
    const double percent = 100.0 / estimates.size();
    rows += fmt::format(
        "<tr><th scope=\"row\">{}</th><td>{:.1f} %</td><td>{:.1f} %</td><td>{:.1f} %</td></tr>\n",
        escaped(network.name), inside[0] * percent, inside[1] * percent, inside[2] * percent);
  }
  return section(
      "Stated uncertainties",
      rows.empty()
          ? note("None of these networks states how sure it is: they answer points.")
          : note("How many of the truths lie in the 90 % intervals.") +
                "<div class=\"wide\"><table class=\"numbers\"><thead><tr><th></th><th>sigma_t</th>"
                "<th>albedo</th><th>g</th></tr></thead><tbody>" +
                rows + "</tbody></table></div>");
}

// --- What it took ---

std::string costs_of(const StudyReport& report) {
  std::string text = note(
      "Networks of one parameterization share their first steps, with the loss of an RN; then each "
      "goes on "
      "by itself. Processor time is of these steps, renders included.");
  text +=
      "<div class=\"wide\"><table class=\"numbers\"><thead><tr><th></th><th>shared "
      "steps</th><th>own "
      "steps</th><th>processor time</th><th>by the clock</th></tr></thead><tbody>\n";
  for (const ReportedNetwork& network : report.networks) {
    text += fmt::format(
        "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
        escaped(network.name), report.experiment.shared_steps(), network.cost.steps(),
        duration(network.cost.cpu_seconds()), duration(network.cost.seconds()));
  }
  text += "</tbody></table></div>\n";
  std::string rates;
  for (const v1::RateChoice::Trial& trial : report.rate.trials()) {
    rates += fmt::format("{}{:g} ({})", rates.empty() ? "" : ", ", trial.rate(),
                         trial.has_score() ? fmt::format("{:.3f}", trial.score()) : "diverged");
  }
  text += note(rates.empty()
                   ? fmt::format("Learning rate: {:g}.", report.rate.rate())
                   : fmt::format("Learning rate: {:g}, of these by their validation error: {}.",
                                 report.rate.rate(), rates));
  std::string rows;
  double seconds = 0, cpu = 0;
  for (const v1::StageRecord& stage : report.stages) {
    rows += fmt::format("<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td></tr>\n",
                        escaped(stage.name()), duration(stage.seconds()),
                        duration(stage.cpu_seconds()));
    seconds += stage.seconds();
    cpu += stage.cpu_seconds();
  }
  text += fmt::format(
      "<details><summary>All stages <span>{} by the clock, {} of processors</span></summary><div "
      "class=\"wide\"><table class=\"numbers\"><thead><tr><th></th><th>by the "
      "clock</th><th>processor "
      "time</th></tr></thead><tbody>{}</tbody></table></div></details>\n",
      duration(seconds), duration(cpu), rows);
  text += fmt::format(
      "<details><summary>The experiment file <span>with all "
      "defaults</span></summary><pre>{}</pre></details>\n",
      escaped(to_text_proto(report.experiment)));
  return section("What it took", text);
}

constexpr const char* kStyle = R"(
main { max-width: 75rem; }
.wide { overflow-x: auto; margin: 0 -.25rem; padding: 0 .25rem; }
table.numbers { font-size: .88rem; }
table.numbers, .numbers thead, .numbers tbody { display: revert; }
.numbers tr, .numbers thead tr { display: table-row; }
.numbers th, .numbers td { display: table-cell !important; padding: .3rem .55rem; vertical-align: top; white-space: nowrap !important; }
.numbers tbody tr { border-top: 1px solid var(--line); display: table-row !important; }
.numbers thead th { white-space: normal !important; vertical-align: bottom; }
.numbers tbody th { position: sticky; left: 0; background: var(--card); }
.numbers small { display: block; color: var(--soft); font-size: .78em; }
.numbers .yardstick, .numbers .published { color: var(--soft); }
.numbers .published { font-style: italic; }
.strip { display: grid; grid-auto-flow: column; grid-auto-columns: minmax(7rem, 1fr); gap: .5rem; margin-bottom: .4rem; }
.wide + .wide { margin-top: 1.1rem; }
.strip figcaption { font-size: .75rem; line-height: 1.3; }
.name { margin-top: 1rem; }
)";

}  // namespace

std::string report_page(const StudyReport& report) {
  std::string body =
      "<header><h1>Inverse transport networks compared</h1><p>Networks that read sigma_t, albedo "
      "and g of a "
      "translucent material off one image (Che et al., ICCP 2020), on images that none of them has "
      "learned from.</p></header>\n";
  for (const Table& table : report.tables) body += html_of(table);
  body += section(
      "Scenes of the test",
      note("Below each name: sigma_t [1/mm], albedo, g. Second rows: difference to the truth, "
           "red where the render is brighter, blue where it is darker.") +
          montage(report, StudyScene::kSame));
  body += colours_of(report);
  body += section("The novel scene", montage(report, StudyScene::kNovel));
  body += trajectories_of(report) + scatter_of(report) + calibration_of(report) +
          training_of(report) + costs_of(report);
  return page("Inverse transport networks compared", body, "", kStyle + plot_style());
}

}  // namespace itn
