#include "client/experiment/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <google/protobuf/util/json_util.h>

#include "client/chart.h"
#include "client/experiment/colours.h"
#include "client/experiment/experiment_config.h"
#include "client/image/preview.h"
#include "client/panels.h"
#include "client/progress.h"
#include "client/scene/text_proto.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

std::string duration(double seconds) {
  return seconds < 10 ? fmt::format("{:.1f} s", seconds)
                      : format_duration(std::chrono::seconds(std::llround(seconds)));
}

std::string section(const std::string& title, const std::string& body) {
  return fmt::format("## {}\n\n{}\n", title, body);
}

// `file`: in the folder of pictures.
std::string picture(const std::string& title, const std::string& file) {
  return fmt::format("![{}](report/{})\n", title, file);
}

std::string table_row(const std::vector<std::string>& cells) {
  return fmt::format("| {} |\n", fmt::join(cells, " | "));
}

std::string table_head(const std::vector<std::string>& cells) {
  return table_row(cells) + table_row(std::vector<std::string>(cells.size(), "---"));
}

// --- Tables ---

bool is_network(const Row& row) {
  return !row.is_published && !row.is_baseline;
}

// Whether this network is the best of a column of errors beyond doubt: its interval lies below
// those of all others.
bool is_best(const Table& table, const Row& row, size_t column) {
  if (!table.columns[column].is_error || !is_network(row)) return false;
  const std::optional<Cell>& own = row.cells[column];
  if (!own || !own->high) return false;
  return std::ranges::all_of(table.rows, [&](const Row& other) {
    const std::optional<Cell>& cell = other.cells[column];
    return &other == &row || !is_network(other) || !cell || (cell->low && *own->high < *cell->low);
  });
}

std::string text_of(const Cell& cell, const Column& column, bool is_bold) {
  std::string text = fmt::format("{:.{}f}", cell.value, column.decimals);
  if (is_bold) text = "**" + text + "**";
  if (cell.low && cell.high && *cell.low == *cell.high) {
    text += " (-)";  // one shape has no interval
  } else if (cell.low && cell.high) {
    text +=
        fmt::format(" ({:.{}f}-{:.{}f})", *cell.low, column.decimals, *cell.high, column.decimals);
  }
  return text;
}

std::string section_of(const Table& table) {
  std::vector<std::string> cells = {""};
  for (const Column& column : table.columns) {
    cells.push_back(column.name + (column.unit.empty() ? "" : fmt::format(" [{}]", column.unit)));
  }
  std::string text = table.caption + "\n\n" + table_head(cells);
  for (const Row& row : table.rows) {
    cells = {row.name};
    for (size_t c = 0; c < table.columns.size(); ++c) {
      const std::optional<Cell>& cell = row.cells[c];
      cells.push_back(cell ? text_of(*cell, table.columns[c], is_best(table, row, c)) : "");
    }
    text += table_row(cells);
  }
  if (std::ranges::any_of(table.rows, &Row::is_published)) {
    text +=
        "\nPublished: Che et al., ICCP 2020, on their own shapes, lights and noise; not to be "
        "compared number by number with ours.\n";
  }
  return section(table.title, text);
}

// --- Pictures: as Figs. 5 and 6 of the paper ---

std::string material_text(const Material& m) {
  return fmt::format("{:.0f}, {:.2f}, {:.2f}", m.sigma_t, m.albedo, m.g);
}

// Shows a row of renders of each image, and a row of their differences to the truth.
std::string scene_section(const ExperimentReport& report, ExperimentScene scene,
                          const std::string& title, const fs::path& file) {
  const int side = report.images.resolution();
  std::vector<PanelRow> rows;
  std::vector<std::string> cells = {"truth"};
  for (const ReportedNetwork& network : report.networks) cells.push_back(network.name);
  std::string materials = table_head(cells);
  for (const size_t k : report.images.shown()) {
    const uint32_t item = report.images.chosen()[k];
    const std::vector<float> truth = report.images.reference(scene, k);
    const float white = white_level(truth);
    const auto gray_panel = [&](const std::vector<float>& radiance) {
      Panel panel{.side = side, .pixels = {}};
      for (const float value : radiance) panel.pixels.push_back(gray(value / white));
      return panel;
    };
    PanelRow renders = {gray_panel(truth)};
    PanelRow differences = {{.side = side, .pixels = std::vector<Rgb>(truth.size(), diverging(0))}};
    cells = {material_text(report.test.truth[item])};
    for (const Candidate& candidate : report.candidates) {
      if (candidate.kind != Candidate::Kind::kNetwork) continue;
      const std::vector<float> radiance =
          report.images.picture(file_name_of(candidate.name), scene, k);
      renders.push_back(gray_panel(radiance));
      Panel& difference = differences.emplace_back(Panel{.side = side, .pixels = {}});
      for (size_t p = 0; p < radiance.size(); ++p) {
        difference.pixels.push_back(diverging((radiance[p] - truth[p]) / white));
      }
      cells.push_back(material_text(candidate.as_trained[item]));
    }
    rows.push_back(std::move(renders));
    rows.push_back(std::move(differences));
    materials += table_row(cells);
  }
  write_panels(file, rows);
  return section(
      title,
      "From left to right the truth and the networks; below, the difference to the truth, "
      "red where the render is brighter, blue where it is darker. sigma_t [1/mm], albedo "
      "and g of each:\n\n" +
          materials + "\n" + picture(title, file.filename().string()));
}

Panel colour_panel(const ColourPicture& colours, int side, float white) {
  Panel panel{.side = side, .pixels = std::vector<Rgb>(colours[0].size())};
  for (size_t p = 0; p < panel.pixels.size(); ++p) {
    for (size_t colour = 0; colour < kColours; ++colour) {
      panel.pixels[p][colour] = gray(colours[colour][p] / white)[colour];
    }
  }
  return panel;
}

std::string colour_section(const ExperimentReport& report, const fs::path& file) {
  const int side = report.colours.resolution();
  const size_t count = static_cast<size_t>(report.colours.manifest().items_size()) / kColours;
  std::vector<PanelRow> rows;
  for (size_t k = 0; k < count; ++k) {
    const ColourPicture input = input_colours(report.colours, k);
    float white = 0;  // all colours on one scale
    for (const std::vector<float>& plane : input) white = std::max(white, white_level(plane));
    PanelRow& row = rows.emplace_back(PanelRow{colour_panel(input, side, white)});
    for (const ReportedNetwork& network : report.networks) {
      row.push_back(
          colour_panel(read_colours(report.pictures, file_name_of(network.name), k), side, white));
    }
  }
  write_panels(file, rows);
  return section("In colour",
                 "Red, green and blue are three materials in one scene. Each is read off a gray "
                 "image by itself and rendered again. From left to right the input and the "
                 "networks.\n\n" +
                     picture("In colour", file.filename().string()));
}

// --- Training ---

std::string training_section(const ExperimentReport& report, const fs::path& file) {
  std::array<Chart, 3> charts = {
      {{.title = "Distance to the truth (training)",
        .x_name = "steps",
        .log_y = true,
        .curves = {}},
       {.title = "Validation error over the constant's", .x_name = "steps", .curves = {}},
       {.title = "Image term (training)", .x_name = "steps", .log_y = true, .curves = {}}}};
  for (const ReportedNetwork& network : report.networks) {
    for (Chart& chart : charts) chart.curves.push_back({.name = network.name, .x = {}, .y = {}});
    const auto add = [&](size_t chart, double step, double value) {
      charts[chart].curves.back().x.push_back(step);
      charts[chart].curves.back().y.push_back(value);
    };
    double before = 0;
    for (const fs::path& path : {network.shared_metrics, network.metrics}) {
      if (path.empty()) continue;
      const std::vector<v1::TrainingMetrics> metrics = read_metrics(path);
      // Means of so many steps are one point.
      const size_t block = std::max<size_t>(1, metrics.size() / 80);
      double regression = 0, image = 0;
      for (size_t s = 0; s < metrics.size(); ++s) {
        const double step = before + metrics[s].step();
        regression += metrics[s].regression_loss() / static_cast<double>(block);
        image += metrics[s].image_loss() / static_cast<double>(block);
        if ((s + 1) % block == 0) {
          add(0, step, regression);
          if (metrics[s].has_image_loss()) add(2, step, image);
          regression = image = 0;
        }
        if (metrics[s].has_validation()) {
          const v1::ValidationMetrics& v = metrics[s].validation();
          add(1, step, (v.sigma_t() + v.albedo() + v.g()) / 3);
        }
      }
      if (!metrics.empty()) before += metrics.back().step();
    }
  }
  write_charts(file, charts);
  return section("Training", picture("Training", file.filename().string()));
}

// --- Analysis by synthesis ---

// How Table 3 goes on, as Fig. 7 of the paper.
std::string refinement_section(const ExperimentReport& report, const fs::path& file) {
  const auto table = std::ranges::find(report.tables, "table_3", &Table::file);
  if (table == report.tables.end()) return {};
  const v1::AnalysisBySynthesis& settings = report.experiment.refinement();
  std::array<Chart, 2> charts = {
      {{.title = "Adam: error over the constant's", .x_name = "iteration", .curves = {}},
       {.title = "Gauss-Newton: error over the constant's", .x_name = "iteration", .curves = {}}}};
  for (const Row& row : table->rows) {
    size_t cell = 0;
    const auto curve = [&](const auto& iterations) {
      Curve result{.name = row.name, .x = {}, .y = {}};
      for (const uint32_t iteration : iterations) {
        result.x.push_back(iteration);
        result.y.push_back(row.cells[cell++]->value);
      }
      return result;
    };
    charts[0].curves.push_back(curve(settings.iterations()));
    charts[1].curves.push_back(curve(settings.gauss_newton_iterations()));
  }
  write_charts(file, charts);
  return section("Refinement, iteration by iteration",
                 picture("Refinement", file.filename().string()));
}

// --- Stated uncertainties ---

std::string calibration_section(const ExperimentReport& report) {
  std::string rows;
  for (const ReportedNetwork& network : report.networks) {
    const v1::ExperimentPredictions::Estimates& estimates = network.predictions.as_trained();
    const int images = estimates.sigma_t_low_size();
    if (images == 0) continue;
    std::array<double, 3> inside{};
    for (int i = 0; i < images; ++i) {
      const Material& truth = report.test.truth[static_cast<size_t>(i)];
      const auto holds = [](double low, double high, double value) {
        return low <= value && value <= high ? 1.0 : 0.0;
      };
      inside[0] += holds(estimates.sigma_t_low(i), estimates.sigma_t_high(i), truth.sigma_t);
      inside[1] += holds(estimates.albedo_low(i), estimates.albedo_high(i), truth.albedo);
      inside[2] += holds(estimates.g_low(i), estimates.g_high(i), truth.g);
    }
    std::vector<std::string> cells = {network.name};
    for (const double count : inside) {
      cells.push_back(fmt::format("{:.1f} %", 100 * count / images));
    }
    rows += table_row(cells);
  }
  return section("Stated uncertainties",
                 rows.empty()
                     ? "None of these networks states how sure it is: they answer points.\n"
                     : "How many of the truths lie in the 90 % intervals.\n\n" +
                           table_head({"", "sigma_t", "albedo", "g"}) + rows);
}

// --- What it took ---

std::string cost_section(const ExperimentReport& report) {
  std::vector<std::string> rates;
  for (const v1::RateChoice::Trial& trial : report.rate.trials()) {
    rates.push_back(
        fmt::format("{:g} ({})", trial.rate(),
                    trial.has_score() ? fmt::format("{:.3f}", trial.score()) : "diverged"));
  }
  std::string text = fmt::format("Learning rate: {:g}", report.rate.rate());
  text += rates.empty() ? ".\n\n"
                        : fmt::format(", of these by their validation error: {}.\n\n",
                                      fmt::join(rates, ", "));
  text += table_head({"stage", "by the clock", "processor time"});
  double seconds = 0, cpu = 0;
  for (const v1::StageRecord& stage : report.stages) {
    text += table_row({stage.name(), duration(stage.seconds()), duration(stage.cpu_seconds())});
    seconds += stage.seconds();
    cpu += stage.cpu_seconds();
  }
  text += table_row({"all", duration(seconds), duration(cpu)});
  return section("What it took", text);
}

}  // namespace

fs::path write_report(const ExperimentReport& report, const fs::path& folder) {
  const fs::path pictures = folder / "report";
  fs::create_directories(pictures);
  std::string text =
      "# Inverse transport networks compared\n\nNetworks that read sigma_t, albedo and g of a "
      "translucent material off one image (Che et al., ICCP 2020), on images that none of them has "
      "learned from.\n\n";
  constexpr uint64_t kFewSteps = 100;
  if (report.experiment.shared_steps() + report.experiment.steps() < kFewSteps) {
    text +=
        "**These numbers mean nothing**: the networks took a few steps each, to show that "
        "everything "
        "works.\n\n";
  }
  text +=
      "Bold: the best network of a column, if its interval lies below those of all others. (-): of "
      "one shape there is no interval.\n\n";
  for (const Table& table : report.tables) text += section_of(table);
  text +=
      scene_section(report, ExperimentScene::kSame, "Scenes of the test", pictures / "scenes.png");
  text += colour_section(report, pictures / "colours.png");
  text += scene_section(report, ExperimentScene::kNovel, "The novel scene", pictures / "novel.png");
  text += refinement_section(report, pictures / "refinement.png");
  text += calibration_section(report);
  text += training_section(report, pictures / "training.png");
  text += cost_section(report);
  text += section("The experiment file, with all defaults",
                  "```\n" + to_text_proto(report.experiment) + "```\n");
  write_file_atomically(folder / "report.md", text);
  return folder / "report.md";
}

}  // namespace itn
