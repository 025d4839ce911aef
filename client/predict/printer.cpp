#include "client/predict/printer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string_view>
#include <vector>

#include "client/json.h"
#include "client/output.h"
#include "client/predict/answer_warnings.h"

namespace itn {
namespace {

// --- Text ---

// The ends of the 90 % intervals under the best guesses, and how the parameters hang together.
void print_interval(const v1::MaterialPosterior& p) {
  const auto print_end = [&](const char* name, double (v1::ParameterPosterior::*end)() const) {
    print_result("{:>7}  {:14.4g}  {:7.4f}  {:7.4f}  {:14.4g}  {:14.4g}\n", name,
                 (p.sigma_t().*end)(), (p.albedo().*end)(), (p.g().*end)(), (p.sigma_a().*end)(),
                 (p.sigma_s().*end)());
  };
  print_end("5 %", &v1::ParameterPosterior::low);
  print_end("95 %", &v1::ParameterPosterior::high);
  if (p.correlations_size() == 3) {
    print_result(
        "         correlations: sigma_t and albedo {:+.2f}, sigma_t and g {:+.2f}, albedo and "
        "g {:+.2f}\n",
        p.correlations(0), p.correlations(1), p.correlations(2));
  }
}

void print_warnings(const v1::AnswerWarnings& caveats) {
  if (caveats.at_bounds_size() > 0) {
    std::vector<std::string> ends;
    for (const int bound : caveats.at_bounds()) {
      ends.push_back(in_words(static_cast<v1::MaterialBound>(bound)));
    }
    print_result("         at an end of what the model can answer, and perhaps beyond it: {}\n",
                 fmt::join(ends, ", "));
  }
  const v1::OutlierScore& outlier = caveats.outlier();
  if (outlier.is_outlier()) {
    print_result(
        "         OUTLIER, {:.1f} times as far from the images of training as 99 % of such "
        "images: do not trust this answer ({})\n",
        outlier.score(), outlier.reason());
  }
}

class TextPrinter final : public PredictionPrinter {
 public:
  explicit TextPrinter(bool several) : several_(several) {}

  void print(const v1::Prediction& prediction) override {
    if (!begun_) {
      print_result("{:7}  {:>14}  {:>7}  {:>7}  {:>14}  {:>14}\n", "channel", "sigma_t [1/mm]",
                   "albedo", "g", "sigma_a [1/mm]", "sigma_s [1/mm]");
      begun_ = true;
    }
    if (several_) print_result("{}\n", prediction.image());
    if (!prediction.error().empty()) print_result("         {}\n", prediction.error());
    for (const v1::Prediction::Channel& c : prediction.channels()) print(prediction, c);
    if (prediction.channels_size() == 0) return;
    for (const v1::Warning& warning : prediction.channels(0).caveats().warnings()) {
      if (in_all_channels(prediction, warning)) print_result("         {}\n", warning.text());
    }
    last_ = prediction;
  }

  // Who it was that answered.
  void finish() override {
    if (last_.channels_size() == 0) return;
    constexpr size_t kShortDigest = 12;
    const v1::ModelVersion& model = last_.model_version();
    print_result(
        "model: {}{}{}{}\n", last_.model(), model.version().empty() ? " (without a version)" : "",
        model.sha256().empty() ? "" : ", weights ", model.sha256().substr(0, kShortDigest));
    if (!last_.channels(0).caveats().has_outlier()) {
      print_result(
          "It does not know the images of its training: whether it was trained for images like "
          "{} is not said.\n",
          several_ ? "these" : "this");
    }
  }

 private:
  static void print(const v1::Prediction& prediction, const v1::Prediction::Channel& c) {
    print_result("{:7}  {:14.4g}  {:7.4f}  {:7.4f}  {:14.4g}  {:14.4g}\n", c.channel(), c.sigma_t(),
                 c.albedo(), c.g(), c.sigma_a(), c.sigma_s());
    if (c.has_posterior()) print_interval(c.posterior());
    print_warnings(c.caveats());
    for (const v1::Warning& warning : c.caveats().warnings()) {
      if (!in_all_channels(prediction, warning)) print_result("         {}\n", warning.text());
    }
  }

  bool several_;
  bool begun_ = false;
  v1::Prediction last_;  // that has an answer
};

// --- JSON ---

class JsonPrinter final : public PredictionPrinter {
 public:
  void print(const v1::Prediction& prediction) override {
    print_result("{}\n", to_json(prediction));
  }
};

// --- CSV (RFC 4180) ---

std::string csv_field(std::string_view text) {
  if (text.find_first_of("\",\r\n") == std::string_view::npos) return std::string(text);
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"') result += '"';
    result += c;
  }
  return result + '"';
}

// One number, and the ends of its interval if there is one.
std::string columns(double value, bool has_posterior, const v1::ParameterPosterior& p) {
  return has_posterior ? fmt::format("{:.6g},{:.6g},{:.6g}", value, p.low(), p.high())
                       : fmt::format("{:.6g},,", value);
}

std::string joined_warnings(const v1::AnswerWarnings& caveats) {
  std::vector<std::string> kinds;
  for (const v1::Warning& warning : caveats.warnings()) {
    kinds.push_back(v1::Warning::Kind_Name(warning.kind()));
  }
  for (const int bound : caveats.at_bounds()) {
    kinds.push_back(v1::MaterialBound_Name(static_cast<v1::MaterialBound>(bound)));
  }
  return fmt::format("{}", fmt::join(kinds, " "));
}

class CsvPrinter final : public PredictionPrinter {
 public:
  void print(const v1::Prediction& prediction) override {
    if (!begun_) {
      print_result(
          "image,channel,sigma_t,sigma_t_low,sigma_t_high,albedo,albedo_low,albedo_high,g,g_low,"
          "g_high,sigma_a,sigma_a_low,sigma_a_high,sigma_s,sigma_s_low,sigma_s_high,object_size,"
          "outlier_score,warnings,model,error\n");
      begun_ = true;
    }
    const std::string image = csv_field(prediction.image());
    for (const v1::Prediction::Channel& c : prediction.channels()) {
      const v1::MaterialPosterior& p = c.posterior();
      const auto number = [&](double value, const v1::ParameterPosterior& parameter) {
        return columns(value, c.has_posterior(), parameter);
      };
      print_result(
          "{},{},{},{},{},{},{},{},{},{},{},\n", image, csv_field(c.channel()),
          number(c.sigma_t(), p.sigma_t()), number(c.albedo(), p.albedo()), number(c.g(), p.g()),
          number(c.sigma_a(), p.sigma_a()), number(c.sigma_s(), p.sigma_s()),
          prediction.has_object_size() ? fmt::format("{:.6g}", prediction.object_size()) : "",
          c.caveats().has_outlier() ? fmt::format("{:.4g}", c.caveats().outlier().score()) : "",
          joined_warnings(c.caveats()), csv_field(prediction.model()));
    }
    if (prediction.channels_size() == 0) {
      constexpr size_t kColumns = 22;
      print_result("{}{}{}\n", image, std::string(kColumns - 1, ','),
                   csv_field(prediction.error()));
    }
  }

 private:
  bool begun_ = false;
};

}  // namespace

std::unique_ptr<PredictionPrinter> prediction_printer(TableFormat format, bool several) {
  switch (format) {
    case TableFormat::kJson: return std::make_unique<JsonPrinter>();
    case TableFormat::kCsv: return std::make_unique<CsvPrinter>();
    default: return std::make_unique<TextPrinter>(several);
  }
}

}  // namespace itn
