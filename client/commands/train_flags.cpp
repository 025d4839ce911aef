// itn train: its flags.
#include <fmt/format.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/config_flags.h"
#include "client/commands/options.h"
#include "client/commands/train.h"
#include "client/presets/presets.h"
#include "client/training/training_config.h"
#include "common/flags.h"
#include "common/learning/parameterization.h"
#include "common/render_limits.h"

namespace itn {
namespace {

using Config = v1::TrainingConfig;

// What belongs together, unless it is said in particular: a residual network takes ratios and
// answers a Gaussian, the paper's takes luminance and weight map and answers a point.
void set_architecture(Config& config, const std::string& preset) {
  const Config belongs = training_preset(preset);
  v1::Architecture& architecture = *config.mutable_architecture();
  if (architecture.kind_case() != belongs.architecture().kind_case()) {
    architecture = belongs.architecture();
  }
  config.set_input(belongs.input());
  config.set_output(belongs.output());
  config.set_parameterization(belongs.parameterization());
}

void set_distribution(Config& config, v1::OutputDistribution output) {
  config.set_output(output);
  config.set_parameterization(output == v1::GAUSSIAN ? v1::UNBOUNDED : v1::SIMILARITY);
}

void add_network_flags(ConfigFlags<Config>& config) {
  config.add_choice<std::string>(
      "--architecture", {{"paper", "paper"}, {"residual", "residual"}}, set_architecture,
      "Layers of the network; paper: convolution, ReLU and pooling down to one pixel, "
      "of luminance and weight map; residual: a residual network of log luminance and "
      "its ratios to means");
  config
      .add<uint32_t>(
          "--base-channels",
          [](Config& changed, uint32_t channels) {
            v1::Architecture& layers = *changed.mutable_architecture();
            if (layers.has_residual_convolutions()) {
              layers.mutable_residual_convolutions()->set_base_channels(channels);
            } else {
              layers.mutable_plain_convolutions()->set_base_channels(channels);
            }
          },
          "Of the first convolution: in [1, 64], default 16 (paper); in [4, 128], default "
          "32 (residual)")
      ->check(number_in(1U, 128U));
  config
      .add<uint32_t>(
          "--blocks",
          [](Config& changed, uint32_t blocks) {
            v1::Architecture& layers = *changed.mutable_architecture();
            if (layers.has_residual_convolutions()) {
              layers.mutable_residual_convolutions()->set_blocks(blocks);
            }
          },
          "Of each stage (residual)")
      ->check(number_in(1U, 4U));
  config.add_choice<v1::OutputDistribution>(
      "--distribution", {{"point", v1::POINT}, {"gaussian", v1::GAUSSIAN}}, set_distribution,
      "What the network answers; point: a best guess; gaussian: a distribution; "
      "default: gaussian for the residual architecture, otherwise point");
  config
      .add<uint32_t>("--components", &Config::set_components,
                     "Gaussians of the distribution, which then is a mixture of them (loss rn); "
                     "default: the preset's, or 1")
      ->check(number_in(1U, kMaxComponents));
  config.add_choice<v1::Parameterization>(
      "--parameterization",
      {{"naive", v1::NAIVE}, {"similarity", v1::SIMILARITY}, {"unbounded", v1::UNBOUNDED}},
      &Config::set_parameterization,
      "Coordinates to learn; default: unbounded for a gaussian, otherwise similarity");
}

void add_augmentation_flags(ConfigFlags<Config>& config) {
  const auto change_of = [](auto setter) {
    return [setter](Config& changed, auto value) {
      std::invoke(setter, *changed.mutable_augmentation(), value);
    };
  };
  config
      .add<std::vector<double>>(
          "--add-noise,--noise",
          [](Config& changed, const std::vector<double>& range) {
            v1::Interval& noise = *changed.mutable_augmentation()->mutable_noise();
            noise.set_min(range.front());
            noise.set_max(range.back());
          },
          "LEVEL or MIN MAX: relative noise of a pixel that every image is brought up to, "
          "afresh in each step, so that noise tells nothing of the material; 0: none is "
          "added")
      ->expected(1, 2)
      ->transform(kPercentToPart)
      ->check(number_in(0.0, 1.0));
  config.add_switch("--mirror,!--no-mirror", change_of(&v1::Augmentation::set_mirror),
                    "Show every second image with left and right exchanged");
  config
      .add<uint32_t>("--shift", change_of(&v1::Augmentation::set_shift),
                     "Move each image by up to so many pixels in x and in y")
      ->check(number_in(0U, 64U));
  config
      .add<double>("--exposure-jitter", change_of(&v1::Augmentation::set_exposure),
                   "Multiply each image by a factor whose logarithm has this standard deviation")
      ->check(number_in(0.0, 3.0));
  config
      .add<double>("--first-order-step,--material-step",
                   change_of(&v1::Augmentation::set_first_order_step),
                   "Make each image that of another material, to first order, by the dataset's "
                   "derivative images (itn dataset --derivatives): standard deviation of the step "
                   "in ln reduced sigma_t and the logits of reduced albedo and g")
      ->check(number_in(0.0, 2.0));
}

void add_optimizer_flags(ConfigFlags<Config>& config) {
  config.add_choice<Config::Optimizer>(
      "--optimizer", {{"adam", Config::ADAM}, {"muon", Config::MUON}}, &Config::set_optimizer,
      "adam, or muon, which learns more in each step: orthogonal steps of the kernels, "
      "Adam's of the rest; default: adam (paper), muon");
  config.add_choice<Config::Precision>(
      "--precision", {{"float32", Config::FLOAT32}, {"bfloat16", Config::BFLOAT16}},
      &Config::set_precision,
      "Of the network's products while it learns; bfloat16: faster where the processor "
      "has instructions for it (avx512_bf16 in /proc/cpuinfo), otherwise slower; "
      "default: float32");
  config
      .add<double>("--learning-rate,--lr", &Config::set_learning_rate,
                   "Learning rate; default: 1e-4 (paper), 4e-3")
      ->check(number_in(0.0, 1e30, Ends::kExcluded));
  config.add_choice<Config::Schedule>(
      "--schedule", {{"constant", Config::CONSTANT}, {"cosine", Config::COSINE}},
      &Config::set_schedule,
      "Of the learning rate; cosine: rises, then falls to a hundredth at the last "
      "step; default: constant (paper), cosine");
  config
      .add<uint64_t>("--warmup-steps", &Config::set_warmup_steps,
                     "In which it rises (cosine); default: 200, or a tenth of all")
      ->check(number_in(uint64_t{0}, uint64_t{UINT32_MAX}));
  config
      .add<double>("--weight-decay", &Config::set_weight_decay,
                   "Of matrices and kernels, times the learning rate; default: 0 (paper), 0.02")
      ->check(number_in(0.0, 1.0));
  config
      .add<double>("--max-gradient-norm", &Config::set_max_gradient_norm,
                   "Longer gradients are shortened to this; 0: never; default: 0 (paper), 5")
      ->check(number_in(0.0, 1e30));
  config
      .add<double>("--weight-average", &Config::set_weight_average_decay,
                   "Decay of the running mean of the weights, which is what the model predicts "
                   "with; 0: the weights of the last step; default: 0 (paper), 0.999")
      ->check(number_in(0.0, 0.999999));
}

void add_image_term_flags(ConfigFlags<Config>& config) {
  config.add_choice<Config::ImageWeights>(
      "--pixel-weights,--image-weights",
      {{"map", Config::WEIGHT_MAP}, {"uniform", Config::UNIFORM}}, &Config::set_image_weights,
      "How pixels count in the image term. map: most near edges; uniform: all of the "
      "object alike. Default: map");
  config
      .add<uint32_t>("--spp", &Config::set_spp,
                     "Samples per pixel of each render (itn); default 256")
      ->check(kSppRange);
  config
      .add<uint32_t>("--estimates", &Config::set_estimates,
                     "Independent estimates that the samples are shared out to (itn); default 4")
      ->check(number_in(2U, kMaxEstimates));
  config
      .add<uint32_t>("--pilot-spp", &Config::set_pilot_spp,
                     "Samples per pixel of each render's pilot, which makes it quieter (itn); 0: "
                     "none; default 4")
      ->check(number_in(0U, kMaxPilotSpp));
  config
      .add<double>("--lambda", &Config::set_lambda,
                   "Weight of the image term (itn); default: balanced on the first ten steps")
      ->check(number_in(0.0, 1e30));
}

}  // namespace

void add_train_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "train", "Train a network with a dataset; the same command continues what was stopped");
  const auto options = std::make_shared<TrainOptions>(*command);
  ConfigFlags<Config>& config = options->changes;
  command->add_option("dataset", options->dataset,
                      "Folder that itn dataset wrote; --resume knows it");
  command->add_option("-o,--output", options->folder, "Folder of the run; required to train");
  command
      ->add_option("--preset", options->preset,
                   fmt::format("Where a new run's configuration starts: {}. The defaults of most "
                               "flags are the preset's",
                               description_of(training_presets())))
      ->check(one_of(names_of(training_presets())))
      ->capture_default_str();
  command->add_option("--config", options->config,
                      "File with fields of itn.v1.TrainingConfig (text format) in the place of the "
                      "preset's; flags win over both");
  command->add_flag("--print-config", options->print_config,
                    "Print the configuration that preset, file and flags make, and end");
  config.add_choice<Config::Loss>(
      "--loss", {{"rn", Config::RN}, {"itn", Config::ITN}}, &Config::set_loss,
      "rn: distance to the truth; itn: and of the re-rendered image to the input");
  add_network_flags(config);
  config.add_choice<v1::Exposure>(
      "--exposure", {{"known", v1::EXPOSURE_KNOWN}, {"unknown", v1::EXPOSURE_UNKNOWN}},
      &Config::set_exposure,
      "Whether the radiance of photographs will be on the dataset's scale; unknown: the "
      "network learns to do without; default: known");
  config
      .add<uint32_t>("--resolution", &Config::set_resolution,
                     "Of the network's input, in pixels: the images are averaged down; 0, the "
                     "default: their own")
      ->check(one_of({"0", "16", "32", "64", "128", "256"}));
  add_augmentation_flags(config);
  command->add_flag(
      "--camera,!--no-camera", options->camera,
      "Show four of five images as cameras and masks drawn by hand make them: another tone curve, "
      "darker corners, out of focus, clipped, the mask a pixel off (CameraAugmentation in "
      "learning.proto)");
  command->add_option(
      "--init", options->init,
      "Checkpoint, run or name of a model (itn models) to start from, e.g. of an RN "
      "for an ITN");
  command
      ->add_option("--model-name", options->model_name,
                   "What answers call the model; default: the name of the run's folder")
      ->check(kModelName);
  command
      ->add_option("--model-version", options->model_version,
                   "Of the model, in answers, e.g. 1.2.0; default: none")
      ->check(kModelName);
  CLI::Option* steps = command->add_option("--steps", options->steps, "Steps to take")
                           ->check(number_in(uint64_t{1}, uint64_t{UINT32_MAX}));
  command->add_option("--epochs", options->epochs, "Instead of steps; default 50")
      ->check(number_in(0.0, 1e6, Ends::kExcluded))
      ->excludes(steps);
  config.add<uint32_t>("--batch", &Config::set_batch, "Images per step; default: 60 (paper), 32")
      ->check(number_in(1U, 65536U));
  config
      .add<uint32_t>(
          "--labels", &Config::set_labels,
          "How many images have labels, chosen by --seed: rn learns from those alone, itn "
          "from renders of the others, too; 0, the default: all")
      ->check(number_in(0U, UINT32_MAX));
  config
      .add<double>("--mean-weight", &Config::set_mean_weight,
                   "Of the squared distance of a Gaussian's mean to the truth, beside minus the "
                   "log-density of the truth; default: 0 (paper), 2")
      ->check(number_in(0.0, 1e30));
  add_optimizer_flags(config);
  add_image_term_flags(config);
  command
      ->add_option("--validate-every", options->validate_every,
                   "Steps between two looks at the dataset's validation split, if it has one; the "
                   "best model is kept as best.itn; 0: never")
      ->check(number_in(uint64_t{0}, uint64_t{1} << 30))
      ->capture_default_str();
  command
      ->add_option("--patience", options->patience,
                   "End after so many validations without a better one; 0: never")
      ->check(number_in(uint64_t{0}, uint64_t{1} << 30))
      ->capture_default_str();
  config.add<uint64_t>("--seed", &Config::set_seed, "Of weights, order and renders; default 0")
      ->check(kAnySeed);
  command->add_option("--checkpoint-every", options->checkpoint_every, "Steps")
      ->check(number_in(uint64_t{1}, uint64_t{1} << 30))
      ->capture_default_str();
  command->add_flag(
      "--resume", options->resume,
      "Continue the folder's run, if there is one: its flags, the dataset too, need not "
      "be given again, and those that are must be the same; --steps may be more");
  command
      ->add_option("--network-threads,--torch-threads", options->torch_threads,
                   "Threads of the network; 0: one per processor. The last bits depend on it: a "
                   "run keeps the number that it began with. To go on by the same command on "
                   "a machine of other processors, give the number; --resume knows it")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  add_format_flags(*command, options->json, "itn.v1.TrainingSummary");
  add_worker_flags(*command, options->workers);
  command->callback([options, command] { run_train(*options, *command); });
}

}  // namespace itn
