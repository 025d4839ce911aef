// itn predict: optical parameters from photographs.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/options.h"
#include "client/commands/predict.h"
#include "client/exports/exports.h"
#include "client/interrupt.h"
#include "client/object_media.h"
#include "client/predict/exported.h"
#include "client/predict/photograph_input.h"
#include "client/predict/picture.h"
#include "client/predict/prediction.h"
#include "client/predict/predictors.h"
#include "client/predict/printer.h"
#include "client/predict/report.h"
#include "client/predict/same_photograph.h"
#include "client/predict/swatches.h"
#include "client/progress.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/scene_file.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/model_files.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// --- Who is asked ---

// Whether the scale of a photograph's radiance is known. A card tells nothing reliable of one that
// was encoded for a screen, unless it is said by which curve.
bool is_scale_known(const PhotographOptions& options, const PredictInput& photograph) {
  if (options.exposure) return true;
  return options.gray_card && options.reading.knows_curve(photograph.capture.encoded());
}

// The model that comes with itn for a photograph.
std::string model_for(const PredictOptions& options, const PredictInput& photograph) {
  if (photograph.channels.size() == 1 || options.matt) return kDefaultGrayModel;
  return is_scale_known(options.photographs, photograph) ? kScaleModel : kDefaultModel;
}

Predict predictor_of(const PredictOptions& options) {
  if (!options.predictor.empty()) {
    return predictor_at(options.predictor, options.security,
                        std::chrono::milliseconds(static_cast<int64_t>(options.timeout * 1000)),
                        options.model.value_or(""), options.version);
  }
  if (options.model) return predictor_here(find_model(*options.model));
  return predictor_here(
      [&options](const PredictInput& photograph) { return model_for(options, photograph); });
}

// --- What became of each ---

// An image that could not be used does not keep others from being answered, unless it is alone.
class Failures {
 public:
  void add(ErrorKind kind) {
    if (count_++ == 0) first_ = kind;
  }
  void throw_if_any(size_t images) const {
    if (count_ > 0) {
      throw Error(first_, fmt::format("{} of {} images could not be used", count_, images));
    }
  }

 private:
  size_t count_ = 0;
  ErrorKind first_ = ErrorKind::kInvalidInput;
};

// Images that are asked for together: no more than any predictor takes. Those of one material are
// one question, however many pixels they have.
constexpr size_t kImagesAtATime = 64;
constexpr uint64_t kPixelsAtATime = uint64_t{1} << 20;

// The next images, loaded, and what is wrong with those that could not be.
struct Group {
  std::vector<std::string> files;
  std::vector<std::optional<Error>> errors;  // by file
  std::vector<PredictInput> loaded;          // without those
};

uint64_t pixels_of(const PredictInput& input) {
  return uint64_t{1} * input.photograph.side * input.photograph.side;
}

Group load_group(const PredictOptions& options, std::span<const std::string> files, bool alone) {
  Group group;
  uint64_t pixels = 0;
  for (const std::string& file : files) {
    if (group.files.size() == kImagesAtATime) break;
    if (pixels >= kPixelsAtATime && !options.one_material) break;
    throw_if_interrupted();
    group.files.push_back(file);
    group.errors.emplace_back();
    try {
      group.loaded.push_back(load_photograph(file, options.photographs));
      pixels += pixels_of(group.loaded.back());
    } catch (const Error& error) {
      if (alone || error.kind() == ErrorKind::kCancelled) throw;
      group.errors.back() = error;
    }
  }
  return group;
}

// What became of each photograph of a group, in the order of its files.
std::vector<std::pair<v1::Prediction, std::optional<Error>>> outcomes_of(
    const Group& group, const v1::PredictBatchReply& reply) {
  if (reply.outcomes_size() != static_cast<int>(group.loaded.size())) {
    throw Error(ErrorKind::kInternal, fmt::format("the predictor answered {} of {} images",
                                                  reply.outcomes_size(), group.loaded.size()));
  }
  std::vector<std::pair<v1::Prediction, std::optional<Error>>> result;
  size_t next = 0;
  for (size_t i = 0; i < group.files.size(); ++i) {
    std::optional<Error> error = group.errors[i];
    if (!error) {
      const v1::PredictOutcome& outcome = reply.outcomes(static_cast<int>(next));
      const PredictInput& photograph = group.loaded[next++];
      if (outcome.code() == grpc::StatusCode::OK) {
        result.emplace_back(prediction_of(group.files[i], outcome.reply(), photograph),
                            std::nullopt);
        continue;
      }
      error = to_error({static_cast<grpc::StatusCode>(outcome.code()), outcome.message()},
                       group.files[i]);
    }
    result.emplace_back(failure_of(group.files[i], error->what()), error);
  }
  return result;
}

bool is_table(const std::string& format) {
  return format == "text" || format == "json" || format == "csv";
}

void check_file(const std::string& flag, const std::string& file, const std::string& suffix) {
  if (file.empty()) return;
  const std::string given = fs::path(file).extension().string();
  if ((!given.empty() && given != suffix) || is_stdout(file)) {
    throw Error(ErrorKind::kUsage,
                fmt::format("{} {}: it needs a file of its own, named {}", flag, file, suffix));
  }
  check_writable(file);
}

// That each material has a file of its own, which can be written.
void check_exports(const PredictOptions& options, const std::vector<std::string>& files) {
  if (options.one_material || files.size() == 1) {
    if (!options.output.empty() && !fs::is_directory(options.output)) {
      require_own_suffix(export_format(options.format), options.output);
      check_writable(options.output);
    }
    if (files.size() == 1 || !fs::is_directory(options.output)) return;
    throw Error(ErrorKind::kUsage, "-o must be a file for what several images of one material say");
  }
  if (!fs::is_directory(options.output)) {
    throw Error(ErrorKind::kUsage,
                "-o must be a folder for the materials of several images, or else --one-material");
  }
  check_folder_writable(options.output);
  std::map<fs::path, std::string> images;
  for (const std::string& file : files) {
    const fs::path target = exported_file(options.output, file, export_format(options.format));
    const auto [other, is_new] = images.emplace(target, file);
    if (!is_new) {
      throw Error(ErrorKind::kUsage,
                  fmt::format("the materials of {} and {} would both be written to {}",
                              other->second, file, target.string()));
    }
  }
}

void check(const PredictOptions& options, const std::vector<std::string>& files) {
  const auto usage = [](const std::string& message) { return Error(ErrorKind::kUsage, message); };
  if (options.matt && !options.predictor.empty()) {
    throw usage("--matt chooses a model here; of a predictor, choose it by --model NAME");
  }
  const PhotographOptions& photographs = options.photographs;
  if (files.size() > 1 && !photographs.mask.empty() && !fs::is_directory(photographs.mask)) {
    throw usage(
        "--mask must be a folder for several images, with a mask of the same name for each");
  }
  const bool is_export = !is_table(options.format);
  if (!options.output.empty() && !is_export) {
    throw usage(fmt::format("-o is for the formats of renderers; {} is printed: --format {} > {}",
                            options.format, options.format, options.output));
  }
  if (is_export) check_exports(options, files);
  if (options.one_material && files.size() > kImagesAtATime) {
    throw usage(fmt::format("--one-material takes {} images at most; there are {}", kImagesAtATime,
                            files.size()));
  }
  if (files.size() > 1 && !options.one_material && !(options.picture + options.report).empty()) {
    throw usage("--picture and --report are of one image, or of several with --one-material");
  }
  if (!options.scene.empty() && (options.picture + options.report).empty()) {
    throw usage("--scene is rendered for --picture or --report; name one of them");
  }
  if (files.size() > 1 && !options.scene.empty()) {
    throw usage("--scene is of one image: others show the object from elsewhere");
  }
  std::vector<std::string> inputs = files;
  inputs.insert(inputs.end(), {photographs.mask, options.scene});
  require_no_input("--output", options.output, inputs);
  require_no_input("--picture", options.picture, inputs);
  require_no_input("--report", options.report, inputs);
  check_file("--picture", options.picture, ".png");
  check_file("--report", options.report, ".html");
}

// Each photograph by itself and, of one material, those that are different together.
v1::PredictBatchReply predictions_of(const Predict& predict, const Group& group, bool together) {
  if (group.loaded.empty()) return {};
  if (!together) return predict(group.loaded, false);
  for (const PredictInput& photograph : group.loaded) {
    const PredictInput& first = group.loaded.front();
    if (photograph.channels.size() != first.channels.size()) {
      throw invalid_input(fmt::format(
          "{} has {} channels, and {} has {}: photographs of one material have the same",
          first.name, first.channels.size(), photograph.name, photograph.channels.size()));
    }
  }
  std::vector<std::string> told;
  const std::vector<size_t> different = different_photographs(group.loaded, told);
  for (const std::string& sentence : told) spdlog::warn("{}", sentence);
  if (told.empty()) return predict(group.loaded, true);
  v1::PredictBatchReply reply = predict(group.loaded, false);
  std::vector<PredictInput> counted;
  for (const size_t i : different) counted.push_back(group.loaded[i]);
  *reply.mutable_combined() = predict(counted, true).combined();
  return reply;
}

// The answer for one material by those photographs of a group that could be used.
v1::Prediction combined_prediction(const Group& group, const v1::PredictBatchReply& reply) {
  std::string names;
  const PredictInput* first = nullptr;
  for (int i = 0; i < reply.outcomes_size(); ++i) {
    if (reply.outcomes(i).code() != grpc::StatusCode::OK) continue;
    const PredictInput& photograph = group.loaded[static_cast<size_t>(i)];
    names += (names.empty() ? "" : ", ") + photograph.name;
    if (first == nullptr) first = &photograph;
  }
  if (first == nullptr) {
    throw Error(ErrorKind::kInternal, "the predictor combined images of which it could use none");
  }
  v1::Prediction combined = prediction_of(names, reply.combined(), *first);
  combined.set_combined(true);
  return combined;
}

// --- What is written ---

std::unique_ptr<PredictionPrinter> printer_of(const PredictOptions& options, bool several) {
  if (options.format == "text") return prediction_printer(TableFormat::kText, several);
  if (options.format == "json") return prediction_printer(TableFormat::kJson, several);
  if (options.format == "csv") return prediction_printer(TableFormat::kCsv, several);
  const bool together = options.one_material && several;
  return export_printer(export_format(options.format), options.exports,
                        {.path = options.output,
                         .is_folder = fs::is_directory(options.output),
                         .combined_alone = together});
}

// One image, or several of one material, whose answer is what they say together.
struct Answered {
  Group group;
  v1::PredictBatchReply reply;
  v1::Prediction answer;
};

// The picture, and the page.
void write_for_people(const PredictOptions& options, const std::optional<v1::Scene>& scene,
                      const Answered& answered) {
  std::fflush(stdout);  // the answer is there whatever becomes of them
  const auto& [group, reply, answer] = answered;
  RenderPool pool{RenderPoolOptions()};
  const size_t pictures = (scene ? 1 : 0) + (options.report.empty() ? 0 : kSwatches);
  Progress progress("rendering", "pictures", pictures);
  auto count = [&, done = 0]() mutable { progress.update(++done); };
  if (pictures > 0) progress.update(0);
  Report report;
  report.prediction = answer;
  std::vector<PanelRow> rows;
  for (size_t i = 0; i < group.loaded.size(); ++i) {
    const v1::PredictOutcome& outcome = reply.outcomes(static_cast<int>(i));
    if (outcome.code() != grpc::StatusCode::OK) continue;
    const PredictInput& photograph = group.loaded[i];
    rows.push_back(network_view_panels(photograph));
    if (scene) {
      const auto again = rerendered_panels(
          photograph, rerendered(pool, *scene, photograph, materials_of_1_mm(answer), options.spp));
      count();
      rows.back().insert(rows.back().end(), again.begin(), again.end());
    }
    report.photographs.push_back(
        {prediction_of(photograph.name, outcome.reply(), photograph), rows.back()});
  }
  if (!options.picture.empty()) write_panels(options.picture, rows);
  if (options.report.empty()) return;
  report.swatches = render_swatches(pool, materials_of_1_mm(answer), options.spp, count);
  if (options.predictor.empty()) {
    report.range = range_of_model(
        find_model(options.model.value_or(""), model_for(options, group.loaded.front())));
  }
  report.exports = options.exports;
  progress.finish();
  write_file_atomically(options.report, report_page(report));
}

// --- All of it ---

// What brings the model that knows how bright the light is, where the default one answered.
std::string remedy_for_scale(const PredictOptions& options) {
  if (!options.predictor.empty()) {
    return fmt::format(
        "--model {} asks for one that does, if the predictor has it (itn models --predictor)",
        kScaleModel);
  }
  if (options.model) return fmt::format("--model {} does", kScaleModel);
  return "if the curve of its numbers is that of sRGB, say --encoding srgb; if they are linear, "
         "--encoding linear";
}

// The default models make nothing of how bright a photograph is. (The one for colours takes the
// light's colour from a gray card.)
void warn_unused_inputs(const PredictOptions& options, const v1::PredictBatchReply& reply) {
  const bool card = options.photographs.gray_card.has_value();
  if (!card && !options.photographs.exposure) return;
  const char* const flag = card ? "--gray-card" : "--radiance-scale";
  for (const v1::PredictOutcome& outcome : reply.outcomes()) {
    const std::string& by = outcome.reply().model_version().name();
    if (by == kDefaultGrayModel) {
      spdlog::warn("the model {} makes nothing of {}; {} does, of glossy things in colour", by,
                   flag, kScaleModel);
      return;
    }
    if (by == kDefaultModel) {
      spdlog::warn("the model {} makes nothing of how bright the light is by {}{}; {}", by, flag,
                   card ? ", only of its colour" : "", remedy_for_scale(options));
      return;
    }
  }
}

}  // namespace

void run_predict(const PredictOptions& options) {
  const std::vector<std::string> files = photograph_files(options.images);
  check(options, files);
  std::optional<v1::Scene> scene;
  if (!options.scene.empty()) {
    scene = load_scene(options.scene);
    resolve_media(*scene);
  }
  const bool several = files.size() > 1;
  const Predict predict = predictor_of(options);
  const auto printer = printer_of(options, several);
  Failures failures;
  std::optional<Answered> for_people;
  bool warned = false;
  for (size_t done = 0; done < files.size();) {
    const Group group = load_group(options, std::span(files).subspan(done), !several);
    done += group.files.size();
    const bool together = options.one_material && several;
    const v1::PredictBatchReply reply = predictions_of(predict, group, together);
    if (!std::exchange(warned, true)) warn_unused_inputs(options, reply);
    for (const auto& [prediction, error] : outcomes_of(group, reply)) {
      if (error && !several) throw *error;
      printer->print(prediction);
      if (error) failures.add(error->kind());
      if (!several) for_people = {group, reply, prediction};
    }
    if (together && reply.has_combined()) {
      const v1::Prediction combined = combined_prediction(group, reply);
      printer->print(combined);
      for_people = {group, reply, combined};
    }
  }
  printer->finish();
  if (for_people && !(options.picture + options.report).empty()) {
    write_for_people(options, scene, *for_people);
  }
  failures.throw_if_any(files.size());
}

}  // namespace itn
