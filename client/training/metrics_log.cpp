#include "client/training/metrics_log.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "client/json.h"
#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr const char* kColumns = "metrics.csv";
constexpr const char* kPicture = "curves.png";

// The most points of a picture: more are not seen.
constexpr size_t kMaxPoints = 2000;

// What the picture shows: a curve a row. Neighbours of the same title are in one chart.
struct Drawn {
  std::string_view column;
  const char* title;
  const char* name;  // in the legend
};
constexpr const char* kValidation = "validation: RMSE over the constant predictor's";
constexpr Drawn kDrawn[] = {
    {"regression_loss", "loss of the training images", "distance to the truth"},
    {"image_loss", "relative squared error of the re-rendered image", "image"},
    {"validation_sigma_t", kValidation, "sigma_t"},
    {"validation_albedo", kValidation, "albedo"},
    {"validation_g", kValidation, "g"},
};

struct Column {
  const char* name;
  std::optional<double> value;
};

std::vector<Column> columns_of(const v1::TrainingMetrics& m) {
  const auto if_known = [](bool known, double value) {
    return known ? std::optional(value) : std::nullopt;
  };
  const bool validated = m.has_validation();
  return {{"step", m.step()},
          {"epoch", m.epoch()},
          {"regression_loss", m.regression_loss()},
          {"image_loss", if_known(m.has_image_loss(), m.image_loss())},
          {"lambda", if_known(m.has_lambda(), m.lambda())},
          {"learning_rate", m.learning_rate()},
          {"seconds", m.seconds()},
          {"validation_sigma_t", if_known(validated, m.validation().sigma_t())},
          {"validation_albedo", if_known(validated, m.validation().albedo())},
          {"validation_g", if_known(validated, m.validation().g())}};
}

std::string names() {
  std::vector<std::string> fields;
  for (const Column& column : columns_of({})) fields.emplace_back(column.name);
  return fmt::format("{}", fmt::join(fields, ","));
}

std::string values(const v1::TrainingMetrics& metrics) {
  std::vector<std::string> fields;
  for (const Column& column : columns_of(metrics)) {
    fields.push_back(column.value ? fmt::format("{}", *column.value) : "");
  }
  return fmt::format("{}", fmt::join(fields, ","));
}

// A curve of as many points as can be seen: means of neighbours.
Curve thinned(const Curve& curve) {
  const size_t stride = (curve.x.size() + kMaxPoints - 1) / kMaxPoints;
  if (stride <= 1) return curve;
  Curve result{curve.name, {}, {}};
  for (size_t i = 0; i < curve.x.size(); i += stride) {
    const size_t count = std::min(stride, curve.x.size() - i);
    double x = 0, y = 0;
    for (size_t k = i; k < i + count; ++k) {
      x += curve.x[k] / static_cast<double>(count);
      y += curve.y[k] / static_cast<double>(count);
    }
    result.x.push_back(x);
    result.y.push_back(y);
  }
  return result;
}

}  // namespace

MetricsLog::MetricsLog(const fs::path& folder, uint64_t step)
    : folder_(folder), curves_(std::size(kDrawn)) {
  // What is kept of the steps so far.
  std::ifstream file(folder_ / kMetricsName);
  std::string lines, columns = names() + '\n', line;
  for (uint64_t i = 0; i < step && std::getline(file, line); ++i) {
    v1::TrainingMetrics metrics;
    if (!google::protobuf::util::JsonStringToMessage(line, &metrics).ok()) {
      throw Error(ErrorKind::kDataLoss,
                  fmt::format("{}: line {} is not what itn train writes; remove the file to go on "
                              "without the curves of the past",
                              (folder_ / kMetricsName).string(), i + 1));
    }
    remember(metrics);
    lines += line + '\n';
    columns += values(metrics) + '\n';
  }
  file.close();
  write_file_atomically(folder_ / kMetricsName, lines);
  write_file_atomically(folder_ / kColumns, columns);
  lines_.emplace(folder_ / kMetricsName);
  columns_.emplace(folder_ / kColumns);
}

void MetricsLog::append(const v1::TrainingMetrics& metrics) {
  lines_->add(to_json(metrics));
  columns_->add(values(metrics));
  remember(metrics);
  flush();
}

void MetricsLog::flush() {
  lines_->flush();
  columns_->flush();
}

void MetricsLog::remember(const v1::TrainingMetrics& metrics) {
  for (const Column& column : columns_of(metrics)) {
    const auto* drawn = std::ranges::find(kDrawn, column.name, &Drawn::column);
    if (drawn == std::end(kDrawn) || !column.value) continue;
    Curve& curve = curves_[static_cast<size_t>(drawn - kDrawn)];
    curve.x.push_back(metrics.step());
    curve.y.push_back(*column.value);
  }
}

void MetricsLog::draw() const {
  std::vector<Chart> charts;
  for (size_t i = 0; i < std::size(kDrawn); ++i) {
    if (curves_[i].x.empty()) continue;
    if (charts.empty() || charts.back().title != kDrawn[i].title) {
      charts.push_back({.title = kDrawn[i].title, .x_name = "steps", .log_y = false, .curves = {}});
    }
    charts.back().curves.push_back(thinned(curves_[i]));
    charts.back().curves.back().name = kDrawn[i].name;
  }
  if (!charts.empty()) write_charts(folder_ / kPicture, charts);
}

std::vector<v1::TrainingMetrics> read_metrics(const fs::path& path) {
  std::vector<v1::TrainingMetrics> metrics;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    v1::TrainingMetrics& step = metrics.emplace_back();
    if (!google::protobuf::util::JsonStringToMessage(line, &step).ok()) metrics.pop_back();
  }
  return metrics;
}

}  // namespace itn
