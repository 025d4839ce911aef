#include "client/experiment/experiment_config.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <set>
#include <vector>

#include <fmt/format.h>

#include "client/dataset/dataset_config.h"
#include "client/presets/presets.h"
#include "client/scene/text_proto.h"
#include "client/training/training.h"
#include "client/training/training_config.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/geometry/shapes.h"
#include "common/render_limits.h"

namespace itn {
namespace {

void set_refinement_defaults(v1::AnalysisBySynthesis& refinement) {
  const auto set = [](auto& iterations, std::initializer_list<uint32_t> defaults) {
    if (iterations.empty()) iterations.Add(defaults.begin(), defaults.end());
  };
  if (refinement.images() == 0) refinement.set_images(40);
  if (refinement.spp() == 0) refinement.set_spp(32);
  if (refinement.learning_rate() == 0) refinement.set_learning_rate(0.05);
  if (refinement.max_spp() == 0) refinement.set_max_spp(512);
  set(*refinement.mutable_iterations(), {1, 30, 60, 90, 120, 150});
  set(*refinement.mutable_gauss_newton_iterations(), {1, 2, 4, 8, 12, 15});
}

void set_experiment_defaults(v1::Experiment& experiment) {
  set_defaults(*experiment.mutable_dataset());
  if (experiment.training_preset().empty()) experiment.set_training_preset("paper");
  if (!experiment.has_rate_factor()) experiment.set_rate_factor(1);
  if (experiment.validate_every() == 0) experiment.set_validate_every(500);
  v1::Rerendering& rerendering = *experiment.mutable_rerendering();
  if (rerendering.images() == 0) rerendering.set_images(40);
  if (rerendering.spp() == 0) rerendering.set_spp(64);
  if (rerendering.novel_shape().empty()) rerendering.set_novel_shape("smooth_star");
  if (!rerendering.has_novel_azimuth_degrees()) rerendering.set_novel_azimuth_degrees(200);
  if (rerendering.shown() == 0) rerendering.set_shown(4);
  if (experiment.has_refinement()) set_refinement_defaults(*experiment.mutable_refinement());
  if (experiment.other_noise().has_target()) {
    v1::DatasetConfig config;  // where the defaults of a noise target are
    *config.mutable_noise() = experiment.other_noise().target();
    set_defaults(config);
    *experiment.mutable_other_noise()->mutable_target() = config.noise();
  }
}

void validate_dataset(const v1::Experiment& experiment) {
  v1::DatasetConfig config = experiment.dataset();
  validate(config);
  require(!config.materials().has_colours(),
          "dataset: an experiment is about images with one channel, not in colour");
  require(config.test_fraction() > 0 || config.test_shapes_size() > 0,
          "dataset: there is no test split, and the tables are about it");
  require(config.validation_fraction() > 0 || config.validation_shapes_size() > 0,
          "dataset: there is no validation split, which chooses the learning rate and the step");
  if (!experiment.has_other_noise()) return;
  require(experiment.other_noise().kind_case() != v1::NoiseLevel::KIND_NOT_SET,
          "other_noise says nothing; it is spp or a target");
  config.clear_spp();
  config.clear_noise();
  if (experiment.other_noise().has_target()) {
    *config.mutable_noise() = experiment.other_noise().target();
  } else {
    config.set_spp(experiment.other_noise().spp());
  }
  try {
    validate(config);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("other_noise: {}", error.what()));
  }
}

void validate_search(const v1::RateSearch& search) {
  for (const double rate : search.rates()) {
    require(std::isfinite(rate) && rate > 0,
            fmt::format("rate_search.rates has {}; they must be above 0", rate));
  }
  require(search.rates_size() == 0 || search.steps() >= 1,
          "rate_search.steps is 0; each rate must be tried for a step at least");
}

bool fits_name(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
         std::string_view(" +-,.").find(c) != std::string_view::npos;
}

void validate_networks(const v1::Experiment& experiment) {
  require(experiment.networks_size() > 0, "there are no networks");
  std::set<std::string> names, files;
  for (const v1::ExperimentNetwork& network : experiment.networks()) {
    const std::string& name = network.name();
    require(
        !name.empty() && name.size() <= 60 && std::ranges::all_of(name, fits_name),
        fmt::format("a network is called \"{}\"; a name is up to 60 letters, digits, spaces and "
                    "any of +-,.",
                    name));
    require(files.insert(file_name_of(name)).second,
            fmt::format("two networks are called {}, or nearly so", name));
    if (!network.as_long_as().empty()) {
      require(names.contains(network.as_long_as()),
              fmt::format("{}: as_long_as is \"{}\"; it must be a network before this one", name,
                          network.as_long_as()));
    }
    names.insert(name);
    try {
      validate(own_training(experiment, network, 1e-4));
      if (experiment.shared_steps() > 0) validate(shared_training(experiment, network, 1e-4));
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", name, error.what()));
    }
    const v1::TrainingConfig own = own_training(experiment, network, 1e-4);
    require(experiment.dataset().derivatives() || !has_first_order_augmentation(own),
            fmt::format("{}: augmentation.first_order_step takes derivative images: dataset {{ "
                        "derivatives: true }}",
                        name));
  }
}

void validate_refinement(const v1::Experiment& experiment) {
  const v1::AnalysisBySynthesis& refinement = experiment.refinement();
  for (const std::string& name : refinement.networks()) {
    const auto& networks = experiment.networks();
    require(std::ranges::find(networks, name, &v1::ExperimentNetwork::name) != networks.end(),
            fmt::format("refinement.networks has \"{}\"; there is no network of this name", name));
  }
  const auto require_rising = [](const char* name, const auto& iterations) {
    require(*iterations.begin() == 1 &&
                std::ranges::adjacent_find(iterations, std::ranges::greater_equal()) ==
                    iterations.end(),
            fmt::format("refinement.{} must begin with 1 and rise", name));
  };
  require_rising("iterations", refinement.iterations());
  require_rising("gauss_newton_iterations", refinement.gauss_newton_iterations());
  require(refinement.spp() >= 4 && refinement.max_spp() >= refinement.spp() &&
              refinement.max_spp() <= kMaxSamples,
          fmt::format("refinement.spp and max_spp are {} and {}; they must rise, from 4 to {}",
                      refinement.spp(), refinement.max_spp(), kMaxSamples));
  require(std::isfinite(refinement.learning_rate()) && refinement.learning_rate() > 0,
          fmt::format("refinement.learning_rate is {}; it must be above 0",
                      refinement.learning_rate()));
}

void validate_experiment(const v1::Experiment& experiment) {
  validate_dataset(experiment);
  validate_search(experiment.rate_search());
  require(experiment.steps() >= 1, "steps is 0; each network takes one by itself at least");
  require(experiment.rate_factor() > 0 && experiment.rate_factor() <= 1,
          fmt::format("rate_factor is {}; it must be in (0, 1]", experiment.rate_factor()));
  validate_networks(experiment);
  if (experiment.has_refinement()) validate_refinement(experiment);
  try {
    check_shape_name(experiment.rerendering().novel_shape());
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("rerendering.novel_shape: {}", error.what()));
  }
  require(experiment.rerendering().spp() >= 4 && experiment.rerendering().spp() <= kMaxSamples,
          fmt::format("rerendering.spp is {}; it must be in [4, {}]",
                      experiment.rerendering().spp(), kMaxSamples));
}

v1::Experiment parsed(const std::string& text, const std::string& name) {
  v1::Experiment experiment;
  parse_text_proto(text, name, experiment);
  set_experiment_defaults(experiment);
  try {
    validate_experiment(experiment);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", name, error.what()));
  }
  return experiment;
}

// What all say, and then what this one does.
v1::TrainingConfig training_of(const v1::Experiment& experiment,
                               const v1::ExperimentNetwork& network, double rate) {
  v1::TrainingConfig config =
      overridden(training_preset(experiment.training_preset()), experiment.training());
  config = overridden(std::move(config), network.settings());
  config.set_learning_rate(rate);
  if (network.settings().seed() == 0) config.set_seed(experiment.seed());
  if (config.output() == v1::POINT) config.clear_mean_weight();
  return config;
}

void set_steps(uint64_t steps, v1::TrainingConfig& config) {
  config.set_steps(steps);
  if (config.has_warmup_steps()) {  // not most of a short run
    config.set_warmup_steps(std::min(config.warmup_steps(), steps / 10));
  }
}

}  // namespace

v1::Experiment experiment_of_preset(std::string_view name) {
  const Preset& preset = find_preset(experiment_presets(), name);
  return parsed(std::string(preset.file), fmt::format("preset {}", name));
}

v1::Experiment load_experiment(const std::filesystem::path& path) {
  return parsed(read_file(path, "experiment"), path.string());
}

v1::TrainingConfig own_training(const v1::Experiment& experiment,
                                const v1::ExperimentNetwork& network, double rate) {
  const bool goes_on = experiment.shared_steps() > 0;
  v1::TrainingConfig config =
      training_of(experiment, network, goes_on ? rate * experiment.rate_factor() : rate);
  set_steps(experiment.steps(), config);
  clear_unused_loss_fields(config);
  return config;
}

v1::TrainingConfig shared_training(const v1::Experiment& experiment,
                                   const v1::ExperimentNetwork& network, double rate) {
  v1::TrainingConfig config = training_of(experiment, network, rate);
  config.set_loss(v1::TrainingConfig::RN);
  set_steps(experiment.shared_steps(), config);
  clear_unused_loss_fields(config);
  return config;
}

v1::TrainingConfig search_training(const v1::Experiment& experiment, double rate) {
  v1::TrainingConfig config = training_of(experiment, experiment.networks(0), rate);
  config.set_loss(v1::TrainingConfig::RN);
  set_steps(experiment.rate_search().steps(), config);
  clear_unused_loss_fields(config);
  return config;
}

double configured_rate(const v1::Experiment& experiment) {
  return overridden(training_preset(experiment.training_preset()), experiment.training())
      .learning_rate();
}

std::string file_name_of(const std::string& network) {
  std::string name;
  for (const char c : network) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else if (!name.empty() && name.back() != '_') {
      name += '_';
    }
  }
  if (name.ends_with('_')) name.pop_back();
  return name;
}

}  // namespace itn
