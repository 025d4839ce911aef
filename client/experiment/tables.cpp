#include "client/experiment/tables.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace itn {
namespace {

struct Quantity {
  const char* name;
  const char* unit;
  int decimals;
  double (*value)(const Material&);
};

constexpr std::array<Quantity, 7> kQuantities = {{
    {"sigma_t", "1/mm", 2, [](const Material& m) { return m.sigma_t; }},
    {"albedo", "", 4, [](const Material& m) { return m.albedo; }},
    {"g", "", 4, [](const Material& m) { return m.g; }},
    {"sigma_a", "1/mm", 2, [](const Material& m) { return m.sigma_a(); }},
    {"sigma_s", "1/mm", 2, [](const Material& m) { return m.sigma_s(); }},
    {"sigma_s'", "1/mm", 2, [](const Material& m) { return m.sigma_s_reduced(); }},
    {"ln sigma_t", "", 3, [](const Material& m) { return std::log(m.sigma_t); }},
}};
constexpr size_t kParameters = 3;  // the first of them

std::vector<double> values_of(const Quantity& quantity, std::span<const Material> materials) {
  std::vector<double> values;
  for (const Material& material : materials) values.push_back(quantity.value(material));
  return values;
}

// Errors of the mean of the truth, which is the best constant answer to this very question.
std::vector<double> errors_of_constant(std::span<const double> truth) {
  const double mean =
      std::accumulate(truth.begin(), truth.end(), 0.0) / static_cast<double>(truth.size());
  std::vector<double> errors;
  for (const double value : truth) errors.push_back(mean - value);
  return errors;
}

std::vector<double> errors_of(const Quantity& quantity, std::span<const Material> predictions,
                              std::span<const Material> truth) {
  std::vector<double> errors;
  for (size_t i = 0; i < truth.size(); ++i) {
    errors.push_back(quantity.value(predictions[i]) - quantity.value(truth[i]));
  }
  return errors;
}

bool is_constant(const Candidate& candidate) {
  return candidate.kind == Candidate::Kind::kBaseline && candidate.name == kConstant;
}

std::vector<double> errors_of(const Quantity& quantity, const Candidate& candidate,
                              std::span<const Material> predictions,
                              std::span<const Material> truth) {
  return is_constant(candidate) ? errors_of_constant(values_of(quantity, truth))
                                : errors_of(quantity, predictions, truth);
}

Cell cell(const Estimate& estimate) {
  return {estimate.value, estimate.low, estimate.high};
}

Row row_of(const Candidate& candidate) {
  return {.name = candidate.name,
          .is_published = false,
          .is_baseline = candidate.kind != Candidate::Kind::kNetwork,
          .cells = {}};
}

std::vector<std::string> shapes_of(const TestSet& test, std::span<const uint32_t> images) {
  std::vector<std::string> shapes;
  for (const uint32_t i : images) shapes.push_back(test.shapes[i]);
  return shapes;
}

void add_image_errors(const ShapeBootstrap& shapes, const Candidate::ImageErrors& errors,
                      Row& row) {
  if (errors.relative_l2.empty()) {
    row.cells.resize(row.cells.size() + 2);
    return;
  }
  row.cells.emplace_back(cell(shapes.mean(errors.relative_l2)));
  row.cells.emplace_back(cell(shapes.mean(errors.dissimilarity)));
}

const std::array<Column, 2> kImageColumns = {{{"image L2", "", 4}, {"1 - MS-SSIM", "", 4}}};

// Figures of Che et al., ICCP 2020, Table 1, on their own data: sigma_t, albedo, g.
struct Published {
  const char* name;
  std::array<double, kParameters> errors;
};
constexpr std::array<Published, 3> kPublished = {{
    {"published: constant predictor", {76.3, 0.200, 0.283}},
    {"published: RN+naive", {90.8, 0.180, 0.400}},
    {"published: best network", {60.3, 0.088, 0.282}},
}};

void add_published(Table& table) {
  for (const Published& published : kPublished) {
    Row row{.name = published.name, .is_published = true, .is_baseline = false, .cells = {}};
    for (const double error : published.errors) row.cells.emplace_back(Cell{error, {}, {}});
    row.cells.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
}

TestSet part_of(const TestSet& test, std::span<const uint32_t> images) {
  TestSet part{.truth = {},
               .shapes = shapes_of(test, images),
               .other_noise = {},
               .rerendered = {},
               .refined = {}};
  for (const uint32_t i : images) part.truth.push_back(test.truth[i]);
  return part;
}

std::string over(const TestSet& test) {
  return fmt::format("{} images of {} shapes that no network has seen", test.truth.size(),
                     ShapeBootstrap(test.shapes).shapes());
}

// Squares of the three parameters' errors, and of the constant predictor's.
std::vector<std::vector<double>> squares_of(const TestSet& test, const Candidate& candidate) {
  std::vector<std::vector<double>> terms;
  for (size_t k = 0; k < kParameters; ++k) {
    terms.push_back(errors_of(kQuantities[k], candidate, candidate.as_trained, test.truth));
  }
  for (size_t k = 0; k < kParameters; ++k) {
    terms.push_back(errors_of_constant(values_of(kQuantities[k], test.truth)));
  }
  for (std::vector<double>& term : terms) {
    for (double& value : term) value *= value;
  }
  return terms;
}

// The root of the mean of such squares, over that of the constant answer.
double relative_error(std::span<const double> means, size_t parameter) {
  return std::sqrt(means[parameter] / means[kParameters + parameter]);
}

double mean_relative_error(std::span<const double> means) {
  double sum = 0;
  for (size_t k = 0; k < kParameters; ++k) sum += relative_error(means, k);
  return sum / kParameters;
}

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? "\"\"" : std::string(1, c);
  return result + '"';
}

std::string with_unit(const Column& column) {
  return column.unit.empty() ? column.name : fmt::format("{} [{}]", column.name, column.unit);
}

}  // namespace

Table table_1(const TestSet& whole, std::span<const Candidate> candidates, bool other_noise) {
  const TestSet test = other_noise ? part_of(whole, whole.other_noise) : whole;
  Table table;
  table.file = other_noise ? "table_1_other_noise" : "table_1";
  table.title = other_noise ? "Table 1 at another noise: errors of the parameters"
                            : "Table 1: errors on unseen shapes and lights";
  table.caption = fmt::format(
      "Root-mean-square errors over {}, with 95 % intervals by bootstrap over shapes. The constant "
      "predictor answers the mean of the test's own truth, of each column for itself.{}",
      over(test),
      std::ranges::find(candidates, kSimilarity, &Candidate::name) == candidates.end()
          ? ""
          : " The similarity predictor is told sigma_t (1 - albedo g) and the reduced albedo, by "
            "which "
            "materials look alike, and nothing else.");
  for (const Quantity& q : kQuantities) table.columns.push_back({q.name, q.unit, q.decimals});
  if (!other_noise) {
    table.caption += fmt::format(
        " Image errors are means over {} of the images, rendered again with the prediction and "
        "compared "
        "with a render of the truth; that of the truth itself is what noise of the renders leaves.",
        test.rerendered.size());
    table.columns.insert(table.columns.end(), kImageColumns.begin(), kImageColumns.end());
  } else {
    table.caption += " The same scenes and materials as in Table 1, rendered with other noise.";
  }
  const ShapeBootstrap all(test.shapes);
  const ShapeBootstrap rerendered(shapes_of(test, test.rerendered));
  for (const Candidate& candidate : candidates) {
    const std::vector<Material>& predictions =
        other_noise ? candidate.other_noise : candidate.as_trained;
    Row row = row_of(candidate);
    if (candidate.kind == Candidate::Kind::kTruth) {
      if (other_noise) continue;
      row.cells.resize(kQuantities.size());
    } else {
      for (const Quantity& q : kQuantities) {
        row.cells.emplace_back(
            cell(all.root_mean_square(errors_of(q, candidate, predictions, test.truth))));
      }
    }
    if (!other_noise) add_image_errors(rerendered, candidate.same_scene, row);
    table.rows.push_back(std::move(row));
  }
  if (!other_noise) add_published(table);
  return table;
}

Table gain_table(const TestSet& test, std::span<const Candidate> candidates) {
  Table table{.file = "gains",
              .title = "What each network gains",
              .caption = {},
              .columns = {{"sigma_t", "", 3}, {"albedo", "", 3}, {"g", "", 3}, {"mean", "", 3}},
              .rows = {}};
  const auto first = std::ranges::find(candidates, Candidate::Kind::kNetwork, &Candidate::kind);
  if (first == candidates.end()) return table;
  table.caption = fmt::format(
      "Errors of Table 1 over those of the constant predictor, the mean of the three, and that "
      "mean over "
      "the one of {}: below 1 is better. Intervals are of the ratio, over the same draws of "
      "shapes.",
      first->name);
  table.columns.push_back({fmt::format("over {}", first->name), "", 3});
  const ShapeBootstrap shapes(test.shapes);
  const std::vector<std::vector<double>> of_first = squares_of(test, *first);
  for (const Candidate& candidate : candidates) {
    if (candidate.kind == Candidate::Kind::kTruth) continue;
    std::vector<std::vector<double>> terms = squares_of(test, candidate);
    terms.insert(terms.end(), of_first.begin(), of_first.end());
    Row row = row_of(candidate);
    for (size_t k = 0; k < kParameters; ++k) {
      row.cells.emplace_back(cell(shapes.estimate(
          terms, [k](std::span<const double> means) { return relative_error(means, k); })));
    }
    row.cells.emplace_back(cell(shapes.estimate(
        terms, [](std::span<const double> means) { return mean_relative_error(means); })));
    row.cells.emplace_back(cell(shapes.estimate(terms, [](std::span<const double> means) {
      return mean_relative_error(means) / mean_relative_error(means.subspan(2 * kParameters));
    })));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table training_table(std::span<const NetworkTraining> networks) {
  Table table{.file = "training",
              .title = "Training",
              .caption =
                  "Networks of one parameterization share their first steps, with the loss "
                  "of an RN; then each goes on by itself, from the weights of the start "
                  "that did best on the validation split, and is tested with its own best. "
                  "Times are of its own steps, renders included.",
              .columns = {{"shared steps", "", 0, false},
                          {"best of them", "", 0, false},
                          {"own steps", "", 0, false},
                          {"best of these", "", 0, false},
                          {"processor time", "s", 0, false},
                          {"by the clock", "s", 0, false}},
              .rows = {}};
  const auto known = [](double value) {
    return value > 0 ? std::optional(Cell{value, {}, {}}) : std::nullopt;
  };
  for (const NetworkTraining& network : networks) {
    const v1::NetworkCost shared = network.shared.value_or(v1::NetworkCost());
    const v1::NetworkCost own = network.own.value_or(v1::NetworkCost());
    Row& row = table.rows.emplace_back(Row{.name = network.name, .cells = {}});
    for (const double value :
         {static_cast<double>(shared.steps()), static_cast<double>(shared.kept_step()),
          static_cast<double>(own.steps()), static_cast<double>(own.kept_step()), own.cpu_seconds(),
          own.seconds()}) {
      row.cells.push_back(known(value));
    }
  }
  return table;
}

Table thickness_table(const TestSet& test, std::span<const Candidate> candidates) {
  Table table{
      .file = "by_thickness",
      .title = "By optical thickness",
      .caption = fmt::format("Root-mean-square errors by thirds of {} in sigma_t: as the objects "
                             "are 1 mm long, that is their optical thickness.",
                             over(test)),
      .columns = {},
      .rows = {}};
  std::vector<size_t> order(test.truth.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::stable_sort(order, {}, [&](size_t i) { return test.truth[i].sigma_t; });
  std::array<std::span<const size_t>, 3> thirds;
  for (size_t third = 0; third < 3; ++third) {
    const size_t begin = third * order.size() / 3, end = (third + 1) * order.size() / 3;
    thirds[third] = std::span(order).subspan(begin, end - begin);
    if (thirds[third].empty()) return table;
    for (size_t k = 0; k < kParameters; ++k) {
      table.columns.push_back({fmt::format("{} of {:.0f} to {:.0f}", kQuantities[k].name,
                                           test.truth[thirds[third].front()].sigma_t,
                                           test.truth[thirds[third].back()].sigma_t),
                               "", kQuantities[k].decimals});
    }
  }
  for (const Candidate& candidate : candidates) {
    if (candidate.kind == Candidate::Kind::kTruth) continue;
    Row row = row_of(candidate);
    for (const std::span<const size_t> third : thirds) {
      std::vector<Material> truth, predictions;
      std::vector<std::string> names;
      for (const size_t i : third) {
        truth.push_back(test.truth[i]);
        predictions.push_back(candidate.as_trained[i]);
        names.push_back(test.shapes[i]);
      }
      const ShapeBootstrap shapes(names);
      for (size_t k = 0; k < kParameters; ++k) {
        // The constant is that of all images.
        row.cells.emplace_back(
            cell(shapes.root_mean_square(errors_of(kQuantities[k], predictions, truth))));
      }
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table table_2(const TestSet& test, std::span<const Candidate> candidates,
              const std::string& scene) {
  Table table{
      .file = "table_2",
      .title = "Table 2: the predictions in a novel scene",
      .caption = fmt::format(
          "Errors of images of {}, of the materials predicted for {} images of the test, with 95 % "
          "intervals over their shapes.",
          scene, test.rerendered.size()),
      .columns = {kImageColumns.begin(), kImageColumns.end()},
      .rows = {}};
  const ShapeBootstrap shapes(shapes_of(test, test.rerendered));
  for (const Candidate& candidate : candidates) {
    Row row = row_of(candidate);
    add_image_errors(shapes, candidate.novel_scene, row);
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table table_3(const TestSet& test, std::span<const Candidate> candidates,
              const v1::AnalysisBySynthesis& settings) {
  Table table{
      .file = "table_3",
      .title = "Table 3: analysis by synthesis from each answer",
      .caption = fmt::format(
          "Errors of {} images of the test over those of the constant predictor, mean of the "
          "three parameters, at iterations of Adam ({} samples per pixel) and of Gauss-Newton "
          "(whose samples grow from there to {}); shape and light are known. Iteration 1 is the "
          "start. Intervals are over shapes. The last columns are the mean processor time of the "
          "renders of an image.",
          test.refined.size(), settings.spp(), settings.max_spp()),
      .columns = {},
      .rows = {}};
  for (const uint32_t i : settings.iterations()) {
    table.columns.push_back({fmt::format("Adam {}", i), "", 3});
  }
  for (const uint32_t i : settings.gauss_newton_iterations()) {
    table.columns.push_back({fmt::format("Gauss-Newton {}", i), "", 3});
  }
  table.columns.push_back({"Adam", "s", 2, false});
  table.columns.push_back({"Gauss-Newton", "s", 2, false});
  // Squares of the constant answer for the images that are refined, around the mean of all.
  std::array<std::vector<double>, kParameters> constant;
  for (size_t k = 0; k < kParameters; ++k) {
    const std::vector<double> errors = errors_of_constant(values_of(kQuantities[k], test.truth));
    for (const uint32_t i : test.refined) constant[k].push_back(errors[i] * errors[i]);
  }
  const ShapeBootstrap shapes(shapes_of(test, test.refined));
  for (const Candidate& candidate : candidates) {
    if (candidate.refinements.empty()) continue;
    Row row = row_of(candidate);
    const auto add = [&](const auto& iterates, int number) {
      std::vector<std::vector<double>> terms(kParameters);
      for (size_t n = 0; n < test.refined.size(); ++n) {
        const v1::Material& at = iterates(candidate.refinements[n])[number].material();
        const Material refined{at.sigma_t(), at.albedo(), at.g()};
        for (size_t k = 0; k < kParameters; ++k) {
          const double error =
              kQuantities[k].value(refined) - kQuantities[k].value(test.truth[test.refined[n]]);
          terms[k].push_back(error * error);
        }
      }
      terms.insert(terms.end(), constant.begin(), constant.end());
      row.cells.emplace_back(cell(shapes.estimate(
          terms, [](std::span<const double> means) { return mean_relative_error(means); })));
    };
    const auto adam = [](const v1::ExperimentRefinement& r) -> const auto& {
      return r.adam();
    };
    const auto newton = [](const v1::ExperimentRefinement& r) -> const auto& {
      return r.gauss_newton();
    };
    for (int i = 0; i < settings.iterations_size(); ++i) add(adam, i);
    for (int i = 0; i < settings.gauss_newton_iterations_size(); ++i) add(newton, i);
    double adam_seconds = 0, newton_seconds = 0;
    for (const v1::ExperimentRefinement& refinement : candidate.refinements) {
      adam_seconds += refinement.adam().rbegin()->cpu_seconds();
      newton_seconds += refinement.gauss_newton().rbegin()->cpu_seconds();
    }
    const auto count = static_cast<double>(candidate.refinements.size());
    row.cells.emplace_back(Cell{adam_seconds / count, {}, {}});
    row.cells.emplace_back(Cell{newton_seconds / count, {}, {}});
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string to_csv(const Table& table) {
  std::string text = "name,published";
  for (const Column& column : table.columns) {
    const std::string name = with_unit(column);
    text += ',' + quoted(name) + ',' + quoted(name + " low") + ',' + quoted(name + " high");
  }
  text += '\n';
  const auto number = [](const std::optional<double>& value) {
    return value ? fmt::format("{:.6g}", *value) : std::string();
  };
  for (const Row& row : table.rows) {
    text += fmt::format("{},{}", quoted(row.name), row.is_published ? "yes" : "no");
    for (const std::optional<Cell>& cell : row.cells) {
      text += cell ? fmt::format(",{},{},{}", number(cell->value), number(cell->low),
                                 number(cell->high))
                   : ",,,";
    }
    text += '\n';
  }
  return text;
}

std::string to_text(const Table& table) {
  size_t width = 0;
  for (const Row& row : table.rows) width = std::max(width, row.name.size());
  std::string text = fmt::format("{:{}}", "", width);
  std::vector<size_t> widths;
  for (const Column& column : table.columns) {
    widths.push_back(std::max<size_t>(with_unit(column).size(), 8));
    text += fmt::format("  {:>{}}", with_unit(column), widths.back());
  }
  text += '\n';
  for (const Row& row : table.rows) {
    text += fmt::format("{:{}}", row.name, width);
    for (size_t c = 0; c < table.columns.size(); ++c) {
      text += row.cells[c] ? fmt::format("  {:{}.{}f}", row.cells[c]->value, widths[c],
                                         table.columns[c].decimals)
                           : fmt::format("  {:>{}}", "-", widths[c]);
    }
    text += '\n';
  }
  return text;
}

}  // namespace itn
