#include "client/commands/fit_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <vector>

#include "client/chart.h"
#include "client/exports/exports.h"
#include "client/json.h"
#include "client/page.h"
#include "client/refine/refine_result.h"
#include "client/refine/refine_run.h"
#include "common/files/read_file.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

std::string section(std::string_view title, std::string_view body, std::string_view kind = "") {
  return fmt::format("<section class=\"{}\"><h2>{}</h2>\n{}</section>\n", kind, title, body);
}

std::string png_of(const fs::path& file) {
  return read_file(file, "picture");
}

// What is said in words, of the poses and of each colour, once.
std::string trust_of(const v1::FitResult& result) {
  std::vector<std::string> limits;
  bool is_grave = false;
  for (const v1::FitPose& pose : result.poses()) {
    if (!pose.ambiguous()) continue;
    is_grave = true;
    limits.push_back(
        fmt::format("{} poses have the silhouette of the object, and light and shade "
                    "do not tell them apart",
                    pose.alike()));
  }
  for (const v1::RefineResult& one : result.results()) {
    is_grave = is_grave || !has_intervals(one);
    for (const std::string& remark : one.remarks()) {
      if (std::ranges::find(limits, remark) == limits.end()) limits.push_back(remark);
    }
  }
  std::string list = "<ul>";
  for (const std::string& limit : limits) list += fmt::format("<li>{}</li>", html_escaped(limit));
  return section(is_grave ? "Do not trust this answer" : "What limits the answer", list + "</ul>",
                 is_grave ? "trust grave" : "trust care");
}

std::string pictures_of(const v1::FitResult& result, const fs::path& folder) {
  std::string poses = "<div class=\"row\">\n";
  for (int i = 0; i < result.poses_size(); ++i) {
    const std::string name = result.poses_size() == 1 ? "pose.png" : fmt::format("pose_{}.png", i);
    poses += html_figure(png_of(folder / name), "panel", "",
                         fmt::format("The contour of the shape as it was found, over the "
                                     "photograph. {:.0f} mm from the camera",
                                     result.poses(i).range()));
  }
  const std::string stands =
      result.poses().empty() ? "" : section("Where the object stands", poses + "</div>\n");
  return stands +
         section("The photograph beside renders of the answer",
                 html_figure(png_of(folder / "picture.png"), "panel", "",
                             "A row for each colour: photograph, render, and their difference, red "
                             "where the render is brighter, blue where it is darker. What does not "
                             "count is black"));
}

// The loss, and what each iteration was rendered with.
std::string convergence_of(const fs::path& folder) {
  std::istringstream lines(read_file(folder / "trajectory.jsonl", "trajectory"));
  Chart loss{.title = "Squared difference over that of the image and 0",
             .x_name = "iteration",
             .log_y = true,
             .curves = {{"loss", {}, {}}}};
  Chart materials{.title = "sigma_s (1 - g): s, and sigma_a: a, in 1/mm",
                  .x_name = "iteration",
                  .log_y = true,
                  .curves = {}};
  double count = 0;
  for (std::string line; std::getline(lines, line);) {
    v1::RefineIteration iteration;
    from_json(line, "trajectory", iteration);
    ++count;
    loss.curves[0].x.push_back(count);
    loss.curves[0].y.push_back(iteration.loss());
    const auto colours = static_cast<size_t>(iteration.materials_size());
    for (size_t c = 0; materials.curves.size() < 2 * colours; ++c) {
      const std::string name = colours == 1 ? "Y" : kRgb.at(c);
      materials.curves.push_back({name + " s", {}, {}});
      materials.curves.push_back({name + " a", {}, {}});
    }
    for (size_t c = 0; c < colours; ++c) {
      const Material material = from_proto(iteration.materials(static_cast<int>(c)));
      for (const size_t which : {0, 1}) {
        Curve& curve = materials.curves[2 * c + which];
        curve.x.push_back(count);
        curve.y.push_back(which == 0 ? material.sigma_s_reduced() : material.sigma_a());
      }
    }
  }
  const fs::path file = folder / "curves.png";
  write_charts(file, std::vector{loss, materials});
  return section("How it came there", html_figure(png_of(file), "chart", "", "By iteration"));
}

std::string swatches_of(std::span<const Swatch> swatches) {
  std::string row = "<div class=\"row\">\n";
  for (const Swatch& swatch : swatches) {
    row += html_figure(encode_png(swatch.picture), "swatch", "",
                       fmt::format("{}, {}", swatch.shape, swatch.light));
  }
  return section("The material on other shapes",
                 "<p class=\"soft\">Their longest side is as long as the object&#39;s. Without "
                 "gloss.</p>" +
                     row + "</div>\n");
}

std::string exports_of(const std::string& title, const v1::FitResult& result) {
  std::vector<Material> materials;
  for (const v1::RefineResult& one : result.results()) {
    materials.push_back(from_proto(one.material()));
  }
  const v1::RefineResult& first = result.results(0);
  const bool holds = std::ranges::all_of(result.results(), has_intervals);
  ExportOptions options{
      .name = "fitted",
      .provenance = "itn fit, " + title + (holds ? "" : ", of which no interval is known"),
      .any_size = true};
  if (first.has_index() && first.index() > 1) {
    options.boundary = {.index = first.index(), .roughness = first.roughness()};
  }
  std::string text;
  for (const ExportFormat& format : export_formats()) {
    text += fmt::format(
        "<details><summary><b>{}</b> <span>{}</span></summary><div class=\"snippet\">"
        "<button type=\"button\" hidden>Copy</button><pre>{}</pre></div></details>\n",
        html_escaped(format.name), html_escaped(format.description),
        html_escaped(format.write(rgb_material(materials), options)));
  }
  return section("For renderers", text);
}

}  // namespace

std::string fit_report_page(const std::string& title, const v1::FitResult& result,
                            const fs::path& folder, std::span<const Swatch> swatches) {
  const std::string numbers =
      to_table(std::vector(result.results().begin(), result.results().end()));
  return html_page(
      title, fmt::format(
                 "<header><h1>{}</h1><p>Its material, found by rendering its shape.</p></header>\n",
                 html_escaped(title)) +
                 trust_of(result) + pictures_of(result, folder) +
                 section("Answer", fmt::format("<p class=\"soft\">Lengths in mm, with 95 % "
                                               "intervals where those hold.</p><pre>{}</pre>",
                                               html_escaped(numbers))) +
                 swatches_of(swatches) + exports_of(title, result) + convergence_of(folder));
}

}  // namespace itn
