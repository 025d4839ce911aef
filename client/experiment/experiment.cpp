#include "client/experiment/experiment.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>
#include <spdlog/spdlog.h>

#include "client/dataset/dataset.h"
#include "client/dataset/dataset_config.h"
#include "client/dataset/dataset_render.h"
#include "client/dataset/panorama_set.h"
#include "client/dataset/plan.h"
#include "client/dataset/shape_set.h"
#include "client/experiment/colours.h"
#include "client/experiment/experiment_config.h"
#include "client/experiment/images.h"
#include "client/experiment/network_stage.h"
#include "client/experiment/refinements.h"
#include "client/experiment/report.h"
#include "client/files/folder_lock.h"
#include "client/scene/text_proto.h"
#include "client/training/evaluation.h"
#include "client/training/metrics_log.h"
#include "client/training/similarity_predictor.h"
#include "client/training/training.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/learning/checkpoint.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr const char* kExperimentName = "experiment.textproto";
constexpr const char* kTestName = "test.textproto";
constexpr const char* kRateName = "learning_rate.textproto";
// To learn what a step costs.
constexpr uint64_t kTrialSteps = 20;
constexpr const char* kStepsOfRn = "steps of RN";
constexpr const char* kStepsOfItn = "steps of ITN";
constexpr const char* kTruth = "truth, rendered again";

template <typename Message>
Message read_text(const fs::path& path, const std::string& what) {
  Message message;
  parse_text_proto(read_file(path, what), path.string(), message);
  return message;
}

// Writes it; its text tells it from others.
std::string write_text(const fs::path& path, const google::protobuf::Message& message) {
  fs::create_directories(path.parent_path());
  const std::string text = to_short_text_proto(message);
  write_file_atomically(path, text);
  return text;
}

void add(const Workload& part, Workload& all) {
  all.pieces += part.pieces;
  all.done += part.done;
  all.seconds += part.seconds;
}

// The CPU time that this process has taken.
double process_cpu_seconds() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

void require_same(const v1::Experiment& existing, const v1::Experiment& wanted,
                  const fs::path& folder) {
  std::string differences;
  google::protobuf::util::MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&differences);
  if (!differencer.Compare(existing, wanted)) {
    throw invalid_input(
        fmt::format("{} holds another experiment; choose another folder, or the same experiment to "
                    "continue it. Differences:\n{}",
                    folder.string(), differences));
  }
}

// Whether the experiment was begun in a folder. Throws Error (invalid input) if anything else is
// there.
bool was_begun(const v1::Experiment& experiment, const fs::path& folder) {
  const fs::path path = folder / kExperimentName;
  if (fs::exists(path)) {
    require_same(read_text<v1::Experiment>(path, "experiment"), experiment, folder);
    return true;
  }
  if (!fs::exists(folder)) return false;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename() != FolderLock::kName) {
      throw invalid_input(
          fmt::format("{} holds {}, and no experiment; choose an empty or a new folder",
                      folder.string(), entry.path().filename().string()));
    }
  }
  return false;
}

// What killed processes had begun to write, in the folders of the stages too.
void remove_temporary_files(const FolderLock& lock, const fs::path& folder) {
  lock.remove_temporary_files();
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_directory()) lock.remove_temporary_files(fs::relative(entry.path(), folder));
  }
}

v1::DatasetConfig other_noise_config(const v1::Experiment& experiment) {
  v1::DatasetConfig config = experiment.dataset();
  config.clear_spp();
  config.clear_noise();
  config.clear_derivatives();
  if (experiment.other_noise().has_target()) {
    *config.mutable_noise() = experiment.other_noise().target();
  } else {
    config.set_spp(experiment.other_noise().spp());
  }
  return config;
}

// What the dataset of this configuration consists of; with `test_only`, of that alone.
DatasetPlan plan_of(const v1::DatasetConfig& config, bool test_only) {
  DatasetPlan plan =
      plan_dataset(config, shape_set(config.shapes()).shapes, panorama_set(config).panoramas);
  if (test_only) {
    const auto is_no_test = [](const auto& part) { return part.split() != v1::SPLIT_TEST; };
    auto& items = *plan.manifest.mutable_items();
    items.erase(std::remove_if(items.begin(), items.end(), is_no_test), items.end());
    auto& shapes = *plan.manifest.mutable_shapes();
    shapes.erase(std::remove_if(shapes.begin(), shapes.end(), is_no_test), shapes.end());
  }
  return plan;
}

// Numbers of the images of the test that are rendered with the other noise, too.
std::vector<uint32_t> images_of_other_noise(const v1::Experiment& experiment, size_t test_images) {
  if (!experiment.has_other_noise()) return {};
  const size_t count = experiment.other_noise_images();
  return spread(count == 0 ? test_images : count, test_images);
}

DatasetPlan other_noise_plan(const v1::Experiment& experiment) {
  DatasetPlan plan = plan_of(other_noise_config(experiment), true);
  auto& items = *plan.manifest.mutable_items();
  int kept = 0;
  for (const uint32_t i : images_of_other_noise(experiment, static_cast<size_t>(items.size()))) {
    items.SwapElements(kept++, static_cast<int>(i));
  }
  items.DeleteSubrange(kept, items.size() - kept);
  return plan;
}

// Throws Error (invalid input) if a list in a file of results is not as long as the experiment
// says.
void require_length(const fs::path& file, const std::string& list, int length, size_t expected) {
  if (static_cast<size_t>(length) == expected) return;
  throw invalid_input(fmt::format("{}: {} has {} entries; there should be {}", file.string(), list,
                                  length, expected));
}

void require_length(const fs::path& file, const std::string& list,
                    const v1::ExperimentPredictions::Estimates& estimates, size_t expected) {
  require_length(file, list + ".sigma_t", estimates.sigma_t_size(), expected);
  require_length(file, list + ".albedo", estimates.albedo_size(), expected);
  require_length(file, list + ".g", estimates.g_size(), expected);
  // All have intervals, or none has.
  const size_t intervals = estimates.sigma_t_low_size() == 0 ? 0 : expected;
  require_length(file, list + ".sigma_t_low", estimates.sigma_t_low_size(), intervals);
  require_length(file, list + ".sigma_t_high", estimates.sigma_t_high_size(), intervals);
  require_length(file, list + ".albedo_low", estimates.albedo_low_size(), intervals);
  require_length(file, list + ".albedo_high", estimates.albedo_high_size(), intervals);
  require_length(file, list + ".g_low", estimates.g_low_size(), intervals);
  require_length(file, list + ".g_high", estimates.g_high_size(), intervals);
}

std::vector<Material> materials_of(const v1::ExperimentPredictions::Estimates& estimates) {
  std::vector<Material> materials;
  for (int i = 0; i < estimates.sigma_t_size(); ++i) {
    materials.push_back({estimates.sigma_t(i), estimates.albedo(i), estimates.g(i)});
  }
  return materials;
}

// Networks that share their first steps, by what these are.
struct SharedStart {
  std::string file;
  const v1::ExperimentNetwork* first;  // that they are trained for
};

// What tables are made of.
struct Answers {
  TestSet test;
  std::vector<Candidate> candidates;
};

class ExperimentRunner {
 public:
  ExperimentRunner(const v1::Experiment& experiment, const ExperimentRun& run)
      : experiment_(experiment), run_(run) {
    if (experiment.shared_steps() == 0) return;
    for (const v1::ExperimentNetwork& network : experiment.networks()) {
      const std::string key = shared_training(experiment, network, 1).SerializeAsString();
      const auto [existing, is_new] = shared_.try_emplace(key);
      if (is_new) existing->second = {fmt::format("{}", shared_.size()), &network};
      start_of_[network.name()] = existing->second;
    }
  }

  std::vector<Stage> stages();
  // What the networks that have answered say.
  Answers answers();
  std::vector<Table> write_tables(const Answers& answers) const;
  // Writes the tables, and a report if its pictures are there.
  ExperimentResult write_result(const std::vector<v1::StageRecord>& records);

  // The CPU time of this process and of renders elsewhere.
  double cpu_seconds() const {
    return process_cpu_seconds() +
           (pool_ && !run_.pool.workers.empty() ? pool_->statistics().cpu_seconds : 0);
  }

 private:
  Stage dataset_stage(const std::string& name, const fs::path& folder,
                      std::function<DatasetPlan()> plan);
  Stage test_stage();
  TestSet read_test_set() const;
  Stage rate_stage();
  Stage shared_stage(const SharedStart& start);
  Stage network_stage(const v1::ExperimentNetwork& network);
  Stage prediction_stage(const v1::ExperimentNetwork& network);
  Stage reference_stage();
  Stage refinement_stage(const std::string& candidate, std::vector<std::string> after);
  // Compares renders of what one says with renders of the truth.
  Stage image_stage(const std::string& candidate, std::vector<std::string> after);

  std::string train(const std::string& stage, const fs::path& folder, v1::TrainingConfig config,
                    std::optional<fs::path> init, const std::string& model_name);

  fs::path folder(const fs::path& below) const { return run_.folder / below; }
  fs::path network_folder(const v1::ExperimentNetwork& network) const {
    return folder("networks") / file_name_of(network.name());
  }
  fs::path predictions_path(const std::string& name) const {
    return folder("answers") / (file_name_of(name) + ".textproto");
  }
  fs::path refinements_path(const std::string& name) const {
    return folder("refinements") / (file_name_of(name) + ".textproto");
  }
  // A file for each image that is refined.
  fs::path refinements_folder(const std::string& name) const {
    return folder("refinements") / file_name_of(name);
  }
  fs::path errors_path(const std::string& name) const {
    return folder("image_errors") / (file_name_of(name) + ".textproto");
  }
  static std::string stage_of(const v1::ExperimentNetwork& network) {
    return "train " + network.name();
  }
  static std::string stage_of(const SharedStart& start) { return "shared start " + start.file; }

  JobRenderer& pool() {
    if (!pool_) pool_.emplace(run_.pool);
    return *pool_;
  }
  DatasetReader& dataset() {
    if (!dataset_) dataset_.emplace(folder("data"));
    return *dataset_;
  }
  DatasetReader* other_noise() {
    if (!experiment_.has_other_noise()) return nullptr;
    if (!other_noise_) other_noise_.emplace(folder("other_noise"));
    return &*other_noise_;
  }
  DatasetReader& colours() {
    if (!colours_) colours_.emplace(folder("colours"));
    return *colours_;
  }
  const LabelledImages& test() {
    if (!test_) test_ = images_of(dataset(), v1::SPLIT_TEST);
    return *test_;
  }
  // What the images of the test are of, as a stage wrote it.
  const TestSet& test_set() {
    if (!test_set_) test_set_ = read_test_set();
    return *test_set_;
  }
  fs::path references_folder() const { return folder("references"); }
  ExperimentImages& images() {
    if (!images_) {
      images_.emplace(experiment_.rerendering(), dataset(), test(), references_folder(),
                      folder("images"));
    }
    return *images_;
  }
  // `samples`: of each pixel, over those of an image that is compared.
  Workload rerendered_images(double samples) const {
    return {.unit = "images rendered again",
            .pieces = samples * experiment_.rerendering().images()};
  }
  double rate() { return read_text<v1::RateChoice>(folder(kRateName), "learning rate").rate(); }
  // That take as much processor time as the network that it is to take as long as took for its own
  // steps.
  uint64_t steps_in_time_of(const v1::ExperimentNetwork& network);
  // A run whose steps cost as much as those of the network: of an RN its shared start; otherwise a
  // short one of its own.
  fs::path run_like(const v1::ExperimentNetwork& network);
  const v1::ExperimentNetwork& network_of(const std::string& name) const;

  Candidate candidate(const std::string& name, Candidate::Kind kind);
  v1::ExperimentPredictions predictions_of(const std::string& name);
  // What a row of the tables says of each image of the test.
  std::vector<Material> materials_for(const std::string& name);
  std::vector<std::string> baselines();
  bool is_refined(const std::string& network) const;
  void render_pictures(const v1::ExperimentNetwork& network,
                       const v1::ExperimentPredictions& predictions);

  const v1::Experiment& experiment_;
  const ExperimentRun& run_;
  std::map<std::string, SharedStart> shared_;    // by what they do
  std::map<std::string, SharedStart> start_of_;  // by the name of the network
  std::optional<RenderPool> pool_;
  std::optional<DatasetReader> dataset_, other_noise_, colours_;
  std::optional<LabelledImages> test_;
  std::optional<TestSet> test_set_;
  std::optional<ExperimentImages> images_;
};

Stage ExperimentRunner::dataset_stage(const std::string& name, const fs::path& folder,
                                      std::function<DatasetPlan()> plan) {
  return {name,
          {},
          folder / kManifestName,
          [=, this] {
            render_dataset(
                plan(), folder, pool(),
                [&](const DatasetProgress& now) {
                  run_.progress(name, "images", now.done, now.total, "");
                },
                run_.stop);
            return to_text(read_manifest(folder / kManifestName));
          },
          [=] {
            const v1::Dataset manifest = plan().manifest;
            std::vector<fs::path> files;
            for (const v1::DatasetItem& item : manifest.items()) {
              files.push_back(folder / item.file());
            }
            const FilesMade images = files_made(files);
            const double noise = manifest.config().noise().target();
            const double each = noise > 0 ? 1 / (noise * noise) : manifest.config().spp();
            return Workload{.unit = noise > 0 ? "images of a noise" : "images of samples",
                            .pieces = each * manifest.items_size(),
                            .done = each * static_cast<double>(images.count),
                            .seconds = images.seconds};
          }};
}

// Trains, and returns what tells the weights from others.
std::string ExperimentRunner::train(const std::string& stage, const fs::path& folder,
                                    v1::TrainingConfig config, std::optional<fs::path> init,
                                    const std::string& model_name) {
  const uint64_t steps = config.steps();
  train_network(std::move(config), dataset(),
                {.folder = folder,
                 .init = std::move(init),
                 .model_name = model_name,
                 .validate_every = experiment_.validate_every(),
                 .torch_threads = run_.torch_threads,
                 .pool = [this]() -> JobRenderer& { return pool(); },
                 .cpu_seconds = [this] { return cpu_seconds(); },
                 .report =
                     [&](const v1::TrainingMetrics& metrics) {
                       run_.progress(stage, "steps", metrics.step(), steps,
                                     fmt::format("regression {:.4f}", metrics.regression_loss()));
                     },
                 .stop = run_.stop});
  return weights_sha256(read_checkpoint(folder / kBestCheckpointName).model());
}

Stage ExperimentRunner::test_stage() {
  const fs::path path = folder(kTestName);
  return {.name = "truth of the test",
          .after = {"dataset"},
          .output = path,
          .work =
              [=, this] {
                v1::ExperimentTest proto;
                std::map<std::string, uint32_t> numbers;
                for (size_t i = 0; i < test().items.size(); ++i) {
                  proto.add_sigma_t(test().truth[i].sigma_t);
                  proto.add_albedo(test().truth[i].albedo);
                  proto.add_g(test().truth[i].g);
                  const std::string& shape = test().items[i]->shape();
                  const auto [number, is_new] = numbers.try_emplace(shape, numbers.size());
                  if (is_new) proto.add_shapes(shape);
                  proto.add_shape(number->second);
                }
                return write_text(path, proto);
              },
          .workload = [] { return Workload{.unit = "truths", .pieces = 1}; },
          .is_result = true};
}

TestSet ExperimentRunner::read_test_set() const {
  const fs::path file = folder(kTestName);
  const auto proto = read_text<v1::ExperimentTest>(file, "truth of the test");
  const auto images = static_cast<size_t>(proto.sigma_t_size());
  require_length(file, "albedo", proto.albedo_size(), images);
  require_length(file, "g", proto.g_size(), images);
  require_length(file, "shape", proto.shape_size(), images);
  TestSet set;
  for (int i = 0; i < proto.sigma_t_size(); ++i) {
    set.truth.push_back({proto.sigma_t(i), proto.albedo(i), proto.g(i)});
    const uint32_t shape = proto.shape(i);
    if (shape >= static_cast<uint32_t>(proto.shapes_size())) {
      throw invalid_input(fmt::format("{}: shape has {}; there are {} shapes", file.string(), shape,
                                      proto.shapes_size()));
    }
    set.shapes.push_back(proto.shapes(static_cast<int>(shape)));
  }
  set.other_noise = images_of_other_noise(experiment_, images);
  set.rerendered = spread(experiment_.rerendering().images(), images);
  if (experiment_.has_refinement()) set.refined = refined_images(experiment_.refinement(), images);
  return set;
}

// Short runs of the first network; that of the least validation error has the rate of all.
Stage ExperimentRunner::rate_stage() {
  const std::string name = "learning rate";
  const fs::path path = folder(kRateName);
  return {name,
          {"dataset"},
          path,
          [=, this] {
            v1::RateChoice choice;
            if (experiment_.rate_search().rates().empty()) {
              choice.set_rate(configured_rate(experiment_));
              return write_text(path, choice);
            }
            double best = HUGE_VAL;
            for (const double rate : experiment_.rate_search().rates()) {
              const fs::path trial_folder = folder("rates") / fmt::format("{:g}", rate);
              v1::RateChoice::Trial& trial = *choice.add_trials();
              trial.set_rate(rate);
              try {
                train(fmt::format("{} {:g}", name, rate), trial_folder,
                      search_training(experiment_, rate), std::nullopt, "trial");
              } catch (const Diverged&) {
                continue;
              }
              trial.set_score(best_score(trial_folder));
              if (trial.score() < best) {
                best = trial.score();
                choice.set_rate(rate);
              }
            }
            if (best == HUGE_VAL)
              throw invalid_input("the training diverges with every learning rate");
            return write_text(path, choice);
          },
          [this] {
            Workload all{.unit = kStepsOfRn};
            for (const double rate : experiment_.rate_search().rates()) {
              add(training_workload(folder("rates") / fmt::format("{:g}", rate), kStepsOfRn,
                                    experiment_.rate_search().steps()),
                  all);
            }
            return all;
          }};
}

Stage ExperimentRunner::shared_stage(const SharedStart& start) {
  const fs::path path = folder("shared") / start.file;
  const std::string name = stage_of(start);
  return {name,
          {"dataset", "learning rate"},
          path / kBestCheckpointName,
          [=, this] {
            return train(name, path, shared_training(experiment_, *start.first, rate()),
                         std::nullopt, "shared start");
          },
          [=, this] { return training_workload(path, kStepsOfRn, experiment_.shared_steps()); }};
}

Stage ExperimentRunner::network_stage(const v1::ExperimentNetwork& network) {
  const std::string name = stage_of(network);
  const fs::path path = network_folder(network);
  std::vector<std::string> after = {"dataset", "learning rate"};
  const auto start = start_of_.find(network.name());
  if (start != start_of_.end()) after.push_back(stage_of(start->second));
  if (!network.as_long_as().empty()) after.push_back("train " + network.as_long_as());
  return {name, after, path / kBestCheckpointName,
          [=, this, &network] {
            v1::TrainingConfig config = own_training(experiment_, network, rate());
            if (!network.as_long_as().empty()) config.set_steps(steps_in_time_of(network));
            return train(name, path, config,
                         start == start_of_.end()
                             ? std::nullopt
                             : std::optional(folder("shared") / start->second.file),
                         network.name());
          },
          [=, this, &network] {
            // One that is to take as long as another one is told by that one.
            const v1::ExperimentNetwork& like =
                network.as_long_as().empty() ? network : network_of(network.as_long_as());
            const v1::TrainingConfig config = own_training(experiment_, like, 1);
            return training_workload(
                path, config.loss() == v1::TrainingConfig::RN ? kStepsOfRn : kStepsOfItn,
                config.steps());
          }};
}

const v1::ExperimentNetwork& ExperimentRunner::network_of(const std::string& name) const {
  return *std::ranges::find(experiment_.networks(), name, &v1::ExperimentNetwork::name);
}

uint64_t ExperimentRunner::steps_in_time_of(const v1::ExperimentNetwork& network) {
  const double time = read_cost(network_folder(network_of(network.as_long_as()))).cpu_seconds();
  const v1::NetworkCost cost = read_cost(run_like(network));
  const double of_a_step = cost.cpu_seconds() / static_cast<double>(cost.steps());
  return std::max<uint64_t>(1, static_cast<uint64_t>(time / of_a_step));
}

fs::path ExperimentRunner::run_like(const v1::ExperimentNetwork& network) {
  v1::TrainingConfig config = own_training(experiment_, network, rate());
  const auto start = start_of_.find(network.name());
  const bool goes_on = start != start_of_.end();
  if (goes_on && config.loss() == v1::TrainingConfig::RN) {
    return folder("shared") / start->second.file;
  }
  const fs::path trial = network_folder(network) / "trial";
  config.set_steps(kTrialSteps);
  config.set_warmup_steps(std::min<uint64_t>(config.warmup_steps(), kTrialSteps / 10));
  train("trial of " + network.name(), trial, config,
        goes_on ? std::optional(folder("shared") / start->second.file) : std::nullopt, "trial");
  return trial;
}

Stage ExperimentRunner::prediction_stage(const v1::ExperimentNetwork& network) {
  const std::string name = "predict " + network.name();
  std::vector<std::string> after = {"dataset", "colours", stage_of(network)};
  if (experiment_.has_other_noise()) after.emplace_back("other noise");
  const fs::path path = predictions_path(network.name());
  return {name,
          after,
          path,
          [=, this, &network] {
            run_.progress(name, "", 0, 0, "");
            const v1::ExperimentPredictions predictions = predict_test(
                network_folder(network), dataset(), other_noise(), colours(), run_.stop);
            // What was made of other answers.
            fs::remove(errors_path(network.name()));
            fs::remove(refinements_path(network.name()));
            fs::remove_all(folder("images") / file_name_of(network.name()));
            return write_text(path, predictions);
          },
          [] { return Workload{.unit = "predictions", .pieces = 1}; },
          true};
}

Stage ExperimentRunner::reference_stage() {
  const std::string name = "images of the truth";
  return {name,
          {"dataset"},
          references_folder(),
          [=, this] {
            images().render_references(
                pool(),
                [&](size_t done, size_t total) { run_.progress(name, "images", done, total, ""); },
                run_.stop);
            return std::string(name);
          },
          [this] { return rerendered_images(kReferenceSamples); }};
}

Stage ExperimentRunner::image_stage(const std::string& candidate, std::vector<std::string> after) {
  const std::string name = "images of " + candidate;
  after.insert(after.begin(), {"dataset", "images of the truth"});
  const fs::path path = errors_path(candidate);
  return {name,
          after,
          path,
          [=, this] {
            return write_text(path, images().compare(
                                        materials_for(candidate), pool(),
                                        [&](size_t done, size_t total) {
                                          run_.progress(name, "images", done, total, "");
                                        },
                                        run_.stop));
          },
          [this] { return rerendered_images(1); },
          true};
}

Stage ExperimentRunner::refinement_stage(const std::string& candidate,
                                         std::vector<std::string> after) {
  const std::string name = "refine from " + candidate;
  after.insert(after.begin(), "dataset");
  const fs::path path = refinements_path(candidate), images_folder = refinements_folder(candidate);
  return {name,
          after,
          path,
          [=, this] {
            return write_text(path, refine_images(
                                        experiment_.refinement(), dataset(), test(),
                                        materials_for(candidate), images_folder, pool(),
                                        [&](size_t done, size_t total) {
                                          run_.progress(name, "images", done, total, "");
                                        },
                                        run_.stop));
          },
          [=, this] {
            Workload workload{.unit = "refinements",
                              .pieces = static_cast<double>(experiment_.refinement().images())};
            if (!fs::exists(folder(kTestName))) return workload;
            const FilesMade images = files_made(
                refinement_files(experiment_.refinement(), test_set().truth.size(), images_folder));
            workload.done = static_cast<double>(images.count);
            workload.seconds = images.seconds;
            return workload;
          },
          true};
}

bool ExperimentRunner::is_refined(const std::string& network) const {
  const auto& networks = experiment_.refinement().networks();
  return experiment_.has_refinement() &&
         (networks.empty() || std::ranges::find(networks, network) != networks.end());
}

// Who has not looked at the images, and the truth itself.
std::vector<std::string> ExperimentRunner::baselines() {
  std::vector<std::string> names = {kConstant};
  const v1::MaterialChoice& materials = experiment_.dataset().materials();
  if (similarity_predictions({}, materials).has_value()) names.emplace_back(kSimilarity);
  names.emplace_back(kTruth);
  return names;
}

std::vector<Stage> ExperimentRunner::stages() {
  std::vector<Stage> stages;
  stages.push_back(dataset_stage("dataset", folder("data"),
                                 [this] { return plan_of(experiment_.dataset(), false); }));
  if (experiment_.has_other_noise()) {
    stages.push_back(dataset_stage("other noise", folder("other_noise"),
                                   [this] { return other_noise_plan(experiment_); }));
  }
  stages.push_back(dataset_stage("colours", folder("colours"), [this] {
    DatasetPlan test = plan_of(experiment_.dataset(), true);
    const auto count = static_cast<size_t>(test.manifest.items_size());
    return colour_plan(std::move(test), spread(experiment_.rerendering().shown(), count));
  }));
  stages.push_back(test_stage());
  stages.push_back(rate_stage());
  stages.push_back(reference_stage());
  for (const std::string& name : baselines()) stages.push_back(image_stage(name, {}));
  if (experiment_.has_refinement()) stages.push_back(refinement_stage(kConstant, {}));
  for (const v1::ExperimentNetwork& network : experiment_.networks()) {
    const auto start = start_of_.find(network.name());
    if (start != start_of_.end() && start->second.first == &network) {
      stages.push_back(shared_stage(start->second));
    }
    stages.push_back(network_stage(network));
    stages.push_back(prediction_stage(network));
    stages.push_back(image_stage(network.name(), {"predict " + network.name()}));
    if (is_refined(network.name())) {
      stages.push_back(refinement_stage(network.name(), {"predict " + network.name()}));
    }
  }
  return stages;
}

v1::ExperimentPredictions ExperimentRunner::predictions_of(const std::string& name) {
  const fs::path file = predictions_path(name);
  auto predictions = read_text<v1::ExperimentPredictions>(file, "answers");
  require_length(file, "as_trained", predictions.as_trained(), test_set().truth.size());
  require_length(file, "other_noise", predictions.other_noise(), test_set().other_noise.size());
  require_length(
      file, "colours", predictions.colours(),
      kColours * spread(experiment_.rerendering().shown(), test_set().truth.size()).size());
  return predictions;
}

std::vector<Material> ExperimentRunner::materials_for(const std::string& name) {
  LabelledImages labels;
  labels.truth = test_set().truth;
  if (name == kTruth) return labels.truth;
  if (name == kConstant) return constant_predictions(labels);
  if (name == kSimilarity) {
    return similarity_predictions(labels, experiment_.dataset().materials()).value();
  }
  return materials_of(predictions_of(name).as_trained());
}

Candidate::ImageErrors image_errors_of(
    const google::protobuf::RepeatedPtrField<v1::ExperimentImageErrors::Errors>& errors) {
  Candidate::ImageErrors result;
  for (const v1::ExperimentImageErrors::Errors& e : errors) {
    result.relative_l2.push_back(e.relative_l2());
    result.dissimilarity.push_back(e.dissimilarity());
  }
  return result;
}

Candidate ExperimentRunner::candidate(const std::string& name, Candidate::Kind kind) {
  Candidate candidate{.name = name,
                      .kind = kind,
                      .as_trained = {},
                      .other_noise = {},
                      .same_scene = {},
                      .novel_scene = {},
                      .refinements = {}};
  if (kind == Candidate::Kind::kNetwork) {
    const v1::ExperimentPredictions predictions = predictions_of(name);
    candidate.as_trained = materials_of(predictions.as_trained());
    candidate.other_noise = materials_of(predictions.other_noise());
  } else {
    candidate.as_trained = materials_for(name);
    for (const uint32_t i : test_set().other_noise) {
      candidate.other_noise.push_back(candidate.as_trained[i]);
    }
  }
  if (fs::exists(errors_path(name))) {
    const fs::path file = errors_path(name);
    const auto errors = read_text<v1::ExperimentImageErrors>(file, "image errors");
    require_length(file, "same_scene", errors.same_scene_size(), test_set().rerendered.size());
    require_length(file, "novel_scene", errors.novel_scene_size(), test_set().rerendered.size());
    candidate.same_scene = image_errors_of(errors.same_scene());
    candidate.novel_scene = image_errors_of(errors.novel_scene());
  }
  if (fs::exists(refinements_path(name))) {
    const fs::path file = refinements_path(name);
    const auto refinements = read_text<v1::ExperimentRefinements>(file, "refinements");
    const v1::AnalysisBySynthesis& settings = experiment_.refinement();
    require_length(file, "images", refinements.images_size(), test_set().refined.size());
    for (const v1::ExperimentRefinement& image : refinements.images()) {
      require_length(file, "adam", image.adam_size(),
                     static_cast<size_t>(settings.iterations_size()));
      require_length(file, "gauss_newton", image.gauss_newton_size(),
                     static_cast<size_t>(settings.gauss_newton_iterations_size()));
    }
    candidate.refinements.assign(refinements.images().begin(), refinements.images().end());
  }
  return candidate;
}

Answers ExperimentRunner::answers() {
  Answers answers{.test = test_set(), .candidates = {}};
  for (const std::string& name : baselines()) {
    answers.candidates.push_back(
        candidate(name, name == kTruth ? Candidate::Kind::kTruth : Candidate::Kind::kBaseline));
  }
  for (const v1::ExperimentNetwork& network : experiment_.networks()) {
    if (!fs::exists(predictions_path(network.name()))) {
      spdlog::warn("{} is missing: the tables have no row of {}",
                   predictions_path(network.name()).string(), network.name());
      continue;
    }
    answers.candidates.push_back(candidate(network.name(), Candidate::Kind::kNetwork));
  }
  return answers;
}

std::vector<Table> ExperimentRunner::write_tables(const Answers& answers) const {
  const auto& [test, candidates] = answers;
  std::vector<Table> tables = {table_1(test, candidates, false)};
  if (experiment_.has_other_noise()) tables.push_back(table_1(test, candidates, true));
  tables.push_back(gain_table(test, candidates));
  tables.push_back(thickness_table(test, candidates));
  const v1::Rerendering& rerendering = experiment_.rerendering();
  tables.push_back(table_2(test, candidates,
                           fmt::format("a {} lit from {:g} degrees", rerendering.novel_shape(),
                                       rerendering.novel_azimuth_degrees())));
  if (experiment_.has_refinement()) {
    tables.push_back(table_3(test, candidates, experiment_.refinement()));
  }
  std::vector<NetworkTraining> trainings;
  for (const v1::ExperimentNetwork& network : experiment_.networks()) {
    const auto start = start_of_.find(network.name());
    trainings.push_back({.name = network.name(),
                         .shared = start == start_of_.end()
                                       ? std::nullopt
                                       : find_cost(folder("shared") / start->second.file),
                         .own = find_cost(network_folder(network))});
  }
  if (std::ranges::any_of(trainings, [](const NetworkTraining& t) { return t.own.has_value(); })) {
    tables.push_back(training_table(trainings));
  }
  for (const Table& table : tables) {
    write_file_atomically(folder(table.file + ".csv"), to_csv(table));
  }
  return tables;
}

// What the network answered, in pictures; those that are there are kept.
void ExperimentRunner::render_pictures(const v1::ExperimentNetwork& network,
                                       const v1::ExperimentPredictions& predictions) {
  const std::string file = file_name_of(network.name());
  images().render_pictures(file, materials_of(predictions.as_trained()), pool(), run_.stop);
  render_colours(colours(), materials_of(predictions.colours()), experiment_.rerendering().spp(),
                 folder("images"), file, pool(), run_.stop);
}

ExperimentResult ExperimentRunner::write_result(const std::vector<v1::StageRecord>& records) {
  const Answers answers = this->answers();
  ExperimentResult result{.tables = write_tables(answers), .report = {}};
  // Scenes are of the datasets.
  if (!fs::exists(folder("data") / kManifestName) ||
      !fs::exists(folder("colours") / kManifestName)) {
    return result;
  }
  ExperimentReport report{.experiment = experiment_,
                          .tables = result.tables,
                          .test = answers.test,
                          .candidates = answers.candidates,
                          .networks = {},
                          .images = images(),
                          .colours = colours(),
                          .pictures = folder("images"),
                          .rate = read_text<v1::RateChoice>(folder(kRateName), "learning rate"),
                          .stages = records};
  for (const v1::ExperimentNetwork& network : experiment_.networks()) {
    v1::ExperimentPredictions predictions = predictions_of(network.name());
    render_pictures(network, predictions);
    const auto start = start_of_.find(network.name());
    report.networks.push_back(
        {.name = network.name(),
         .metrics = network_folder(network) / kMetricsName,
         .shared_metrics = start == start_of_.end()
                               ? fs::path()
                               : folder("shared") / start->second.file / kMetricsName,
         .predictions = std::move(predictions)});
  }
  result.report = write_report(report, run_.folder);
  return result;
}

}  // namespace

std::vector<std::string> stage_names(const v1::Experiment& experiment) {
  const ExperimentRun nowhere;
  ExperimentRunner study(experiment, nowhere);
  std::vector<std::string> names;
  for (const Stage& stage : study.stages()) names.push_back(stage.name);
  return names;
}

std::vector<StageStatus> stage_status(const v1::Experiment& experiment, const fs::path& folder) {
  was_begun(experiment, folder);
  ExperimentRun run;
  run.folder = folder;
  return stage_status(ExperimentRunner(experiment, run).stages(), folder,
                      to_text_proto_of_01(experiment));
}

std::vector<Table> write_experiment_tables(const fs::path& folder) {
  ExperimentRun run;
  run.folder = folder;
  const v1::Experiment experiment = load_experiment(folder / kExperimentName);
  ExperimentRunner runner(experiment, run);
  return runner.write_tables(runner.answers());
}

ExperimentResult run_experiment(const v1::Experiment& experiment, const ExperimentRun& run) {
  const FolderLock lock(run.folder, "itn experiment");
  if (!was_begun(experiment, run.folder)) write_text(run.folder / kExperimentName, experiment);
  remove_temporary_files(lock, run.folder);
  ExperimentRunner study(experiment, run);
  const std::vector<Stage> stages = study.stages();
  run_stages(
      stages, run.folder, to_text_proto_of_01(experiment), [&] { return study.cpu_seconds(); },
      run.report, run.stop);
  return study.write_result(stage_records(stages, run.folder));
}

}  // namespace itn
