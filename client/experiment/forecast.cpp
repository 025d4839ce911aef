#include "client/experiment/forecast.h"

#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/dataset.h"
#include "client/dataset/distribution.h"
#include "client/dataset/panorama_set.h"
#include "client/dataset/plan.h"
#include "client/dataset/shape_set.h"
#include "client/experiment/experiment.h"
#include "client/experiment/experiment_config.h"
#include "client/experiment/network_stage.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/scene/text_proto.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr uint32_t kImages = 24;
constexpr uint64_t kSteps = 3;

// A folder that goes with it.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (fs::temp_directory_path() / "itn-forecast-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
      throw Error(ErrorKind::kIo,
                  fmt::format("cannot create a folder in {}", fs::temp_directory_path().string()));
    }
    path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

uint64_t bytes_in(const fs::path& folder) {
  uint64_t bytes = 0;
  if (!fs::exists(folder)) return 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) bytes += entry.file_size();
  }
  return bytes;
}

// A grid of so few materials would have the same ones only.
void spread_out(v1::Distribution& distribution, bool is_logarithmic) {
  if (!is_list(distribution)) return;
  const v1::Interval range = range_of(distribution);
  distribution =
      is_logarithmic ? log_uniform(range.min(), range.max()) : uniform(range.min(), range.max());
}

// Images of the dataset, by split.
struct Counts {
  double all = 0, train = 0, validation = 0, test = 0;
};

Counts counts_of(const v1::DatasetConfig& config) {
  const DatasetPlan plan =
      plan_dataset(config, shape_set(config.shapes()).shapes, panorama_set(config).panoramas);
  Counts counts;
  for (const v1::DatasetItem& item : plan.manifest.items()) {
    ++counts.all;
    ++(item.split() == v1::SPLIT_TEST         ? counts.test
       : item.split() == v1::SPLIT_VALIDATION ? counts.validation
                                              : counts.train);
  }
  return counts;
}

// Samples of so many iterations whose number doubles up to the most that are allowed: what
// refinements by Gauss-Newton take.
double doubling_samples(const v1::AnalysisBySynthesis& settings) {
  double samples = 0, spp = settings.spp();
  for (uint32_t i = 0; i < *settings.gauss_newton_iterations().rbegin(); ++i) {
    samples += spp;
    spp = std::min<double>(2 * spp, settings.max_spp());
  }
  return samples;
}

double samples_of(const v1::AnalysisBySynthesis& settings) {
  return static_cast<double>(settings.spp()) * *settings.iterations().rbegin() +
         doubling_samples(settings);
}

}  // namespace

v1::Experiment miniature(const v1::Experiment& experiment) {
  v1::Experiment small = experiment;
  v1::DatasetConfig& dataset = *small.mutable_dataset();
  dataset.set_count(kImages);
  if (dataset.shapes().has_random()) {
    dataset.mutable_shapes()->mutable_random()->set_count(
        std::min(kImages / 2, dataset.shapes().random().count()));
    dataset.clear_test_shapes();  // which may not be among the first
    dataset.clear_validation_shapes();
  }
  if (dataset.test_shapes().empty()) dataset.set_test_fraction(0.25);
  if (dataset.validation_shapes().empty()) dataset.set_validation_fraction(0.25);
  v1::MaterialChoice& materials = *dataset.mutable_materials();
  if (materials.sampling() == v1::MaterialChoice::GRID) {
    materials.set_sampling(v1::MaterialChoice::STRATIFIED);
    spread_out(*materials.mutable_sigma_t(), true);
    spread_out(*materials.mutable_albedo(), false);
    spread_out(*materials.mutable_g(), false);
  }
  small.clear_rate_search();
  if (small.shared_steps() > 0) small.set_shared_steps(kSteps);
  small.set_steps(kSteps);
  small.set_validate_every(kSteps);
  for (v1::StudyNetwork& network : *small.mutable_networks()) network.clear_as_long_as();
  small.mutable_rerendering()->set_images(2);
  small.mutable_rerendering()->set_shown(1);
  if (small.has_refinement()) {
    small.mutable_refinement()->set_images(1);
    for (auto* iterations : {small.mutable_refinement()->mutable_iterations(),
                             small.mutable_refinement()->mutable_gauss_newton_iterations()}) {
      iterations->Clear();
      iterations->Add(1);
      iterations->Add(3);
    }
  }
  return small;
}

std::vector<StageForecast> forecast(const v1::Experiment& experiment, const RenderPoolOptions& pool,
                                    uint32_t torch_threads, std::stop_token stop) {
  const ScratchFolder scratch;
  const v1::Experiment small = miniature(experiment);
  std::map<std::string, double> seconds;
  run_experiment(
      small,
      {.folder = scratch.path(),
       .pool = pool,
       .torch_threads = torch_threads,
       .progress = [](const auto&...) {},
       .report = [&](size_t, const Stage& stage, StageState,
                     const v1::StageRecord& record) { seconds[stage.name] = record.seconds(); },
       .stop = std::move(stop)});
  return extrapolated(experiment, small, scratch.path(), std::move(seconds));
}

std::vector<StageForecast> extrapolated(const v1::Experiment& experiment,
                                        const v1::Experiment& small, const fs::path& run,
                                        std::map<std::string, double> seconds) {
  const Counts now = counts_of(small.dataset()), then = counts_of(experiment.dataset());
  const auto folder = [&](const std::string& name) { return run / name; };
  const auto images = [](const v1::Experiment& e, double test) {
    return std::min<double>(e.rerendering().images(), test);
  };
  const auto other_noise_images = [](const v1::Experiment& e, double test) {
    return e.other_noise_images() == 0 ? test : std::min<double>(e.other_noise_images(), test);
  };
  // A look at the validation split, in steps: an image that goes forward only takes about a third.
  const double validations =
      then.validation / 3 / own_training(experiment, experiment.networks(0), 1).batch();
  // Of so many steps like those of a run of the miniature, with looks at the validation split.
  const auto training = [&](const fs::path& like, uint64_t steps) {
    const v1::NetworkCost cost = read_cost(like);
    const double step = cost.seconds() / static_cast<double>(cost.steps());
    const double looks =
        std::ceil(static_cast<double>(steps) / static_cast<double>(experiment.validate_every()));
    return step * (static_cast<double>(steps) + looks * validations);
  };
  const auto run_of = [&](const std::string& network) {
    return folder("networks") / file_name_of(network);
  };
  std::vector<StageForecast> result;
  for (const std::string& name : stage_names(experiment)) {
    StageForecast stage{.name = name, .seconds = seconds[name], .bytes = 0};
    if (name == "dataset") {
      stage.seconds *= then.all / now.all;
      stage.bytes =
          static_cast<uint64_t>(static_cast<double>(bytes_in(folder("data"))) * then.all / now.all);
    } else if (name == "other noise") {
      const double grows =
          other_noise_images(experiment, then.test) / other_noise_images(small, now.test);
      stage.seconds *= grows;
      stage.bytes =
          static_cast<uint64_t>(static_cast<double>(bytes_in(folder("other_noise"))) * grows);
    } else if (name == "learning rate") {
      const fs::path like = experiment.shared_steps() > 0 ? folder("shared") / "1"
                                                          : run_of(experiment.networks(0).name());
      stage.seconds =
          experiment.rate_search().rates_size() * training(like, experiment.rate_search().steps());
    } else if (name.starts_with("shared start ")) {
      const fs::path like = folder("shared") / name.substr(std::string("shared start ").size());
      stage.seconds = training(like, experiment.shared_steps());
      stage.bytes = bytes_in(like);
    } else if (name.starts_with("images of ")) {
      stage.seconds *= images(experiment, then.test) / images(small, now.test);
    } else if (name.starts_with("colours")) {
      stage.seconds *=
          static_cast<double>(experiment.rerendering().shown()) / small.rerendering().shown();
    } else if (name.starts_with("predict ")) {
      stage.seconds *= then.test / now.test;
    } else if (name.starts_with("refine from ")) {
      stage.seconds *= std::min<double>(experiment.refinement().images(), then.test) *
                       samples_of(experiment.refinement()) / samples_of(small.refinement());
    }
    result.push_back(stage);
  }
  // Networks, those last that take as long as others.
  for (StageForecast& stage : result) {
    for (const v1::StudyNetwork& network : experiment.networks()) {
      if (stage.name != "train " + network.name()) continue;
      stage.bytes = bytes_in(run_of(network.name()));
      stage.seconds = training(run_of(network.name()), experiment.steps());
      if (network.as_long_as().empty()) continue;
      stage.seconds =
          std::ranges::find(result, "train " + network.as_long_as(), &StageForecast::name)->seconds;
    }
  }
  return result;
}

}  // namespace itn
