#include "client/experiment/presets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <initializer_list>
#include <string>

#include "common/error.h"

namespace itn {
namespace {

// The five networks of Che et al. 2020, and two that tell what their gains come from.
constexpr std::string_view kFiveNetworks = R"(
networks {
  name: "RN+naive"
  settings { loss: RN parameterization: NAIVE }
}
networks {
  name: "ITN+naive"
  settings { loss: ITN parameterization: NAIVE image_weights: UNIFORM }
}
networks {
  name: "RN+similar"
  settings { loss: RN parameterization: SIMILARITY }
}
networks {
  name: "ITN+similar"
  settings { loss: ITN parameterization: SIMILARITY image_weights: UNIFORM }
}
networks {
  name: "ITN+similar+map"
  settings { loss: ITN parameterization: SIMILARITY image_weights: WEIGHT_MAP }
}
# Whether more steps would have done what renders do.
networks {
  name: "RN+similar, time of ITN"
  settings { loss: RN parameterization: SIMILARITY }
  as_long_as: "ITN+similar+map"
}
)";

constexpr std::string_view kSmokeExperiment =
    R"(# Whether everything works: less than a minute. Its numbers mean nothing.
dataset {
  count: 60
  resolution: 32
  spp: 16
  shapes { random { count: 15 } }
  test_fraction: 0.3
  validation_fraction: 0.2
  pose { turned: 1 }
}
other_noise { spp: 64 }
other_noise_images: 6
training_preset: "residual"
training {
  architecture { residual_convolutions { base_channels: 4 blocks: 1 } }
  output: POINT
  batch: 4
  warmup_steps: 2
  augmentation { mirror: true shift: 1 noise { min: 0.3 max: 0.3 } }
  spp: 8
}
rate_search { rates: [1e-3, 4e-3] steps: 10 }
shared_steps: 30
steps: 5
rate_factor: 0.25
validate_every: 5
rerendering { images: 3 spp: 16 shown: 2 }
refinement {
  images: 2
  spp: 8
  iterations: [1, 3]
  gauss_newton_iterations: [1, 3]
  max_spp: 32
}
)";

constexpr std::string_view kSmallExperiment =
    R"(# Results that mean something in less than an hour on two cores: many random shapes that turn, images of
# 64 x 64 pixels whose noise is made equal and covered by more, so that it tells nothing of the material,
# and a small residual network.
dataset {
  count: 6000
  resolution: 64
  noise { target: 0.08 }
  shapes { random { count: 1500 } }
  test_fraction: 0.08
  validation_fraction: 0.05
  pose { turned: 1 }
}
# About a quarter of the variance.
other_noise { target { target: 0.04 } }
training_preset: "residual"
training {
  architecture { residual_convolutions { base_channels: 16 blocks: 1 } }
  output: POINT
  batch: 32
  augmentation { mirror: true shift: 2 noise { min: 0.16 max: 0.16 } }
  spp: 8
}
rate_search { rates: [2e-3, 4e-3, 8e-3] steps: 600 }
shared_steps: 5000
steps: 800
rate_factor: 0.25
validate_every: 100
rerendering { images: 80 spp: 64 shown: 4 }
refinement { images: 40 spp: 16 max_spp: 1024 }
)";

constexpr std::string_view kAblationExperiment =
    R"(# What the image term is worth by the samples of its renders, without a render, and against more steps or
# more materials: all in the processor time of the dearest.
dataset {
  count: 4000
  resolution: 64
  noise { target: 0.08 }
  derivatives: true
  shapes { random { count: 1000 } }
  test_fraction: 0.12
  validation_fraction: 0.05
  pose { turned: 1 }
}
training_preset: "residual"
training {
  parameterization: SIMILARITY
  architecture { residual_convolutions { base_channels: 16 blocks: 1 } }
  output: POINT
  batch: 32
  learning_rate: 4e-3
  augmentation { mirror: true shift: 2 noise { min: 0.16 max: 0.16 } }
}
shared_steps: 3000
steps: 100
rate_factor: 0.25
validate_every: 50
rerendering { images: 80 spp: 64 shown: 4 }
networks {
  name: "RN, as many steps"
  settings { loss: RN }
}
networks {
  name: "ITN, 64 spp"
  settings { loss: ITN spp: 64 }
}
networks {
  name: "ITN, 16 spp"
  settings { loss: ITN spp: 16 }
  as_long_as: "ITN, 64 spp"
}
networks {
  name: "ITN, 4 spp"
  settings { loss: ITN spp: 4 }
  as_long_as: "ITN, 64 spp"
}
networks {
  name: "RN, as long"
  settings { loss: RN }
  as_long_as: "ITN, 64 spp"
}
networks {
  name: "RN, moved materials"
  settings { loss: RN augmentation { first_order_step: 0.3 } }
  as_long_as: "ITN, 64 spp"
}
)";

// Followed by networks (few_shapes_experiment()).
constexpr std::string_view kFewShapesExperiment =
    R"(# What the image term is worth where shapes are few: as many images of 6 shapes as of hundreds, and three
# seeds. For 22 or 300 shapes: shapes { random { count: 72 } } or 350. 40 of them are the
# test and 10 the validation, the same images whatever the count.
dataset {
  count: 2000
  resolution: 64
  noise { target: 0.08 }
  shapes { random { count: 56 } }
  test_shapes: [
    "random-0-0", "random-0-1", "random-0-2", "random-0-3", "random-0-4", "random-0-5", "random-0-6",
    "random-0-7", "random-0-8", "random-0-9", "random-0-10", "random-0-11", "random-0-12",
    "random-0-13", "random-0-14", "random-0-15", "random-0-16", "random-0-17", "random-0-18",
    "random-0-19", "random-0-20", "random-0-21", "random-0-22", "random-0-23", "random-0-24",
    "random-0-25", "random-0-26", "random-0-27", "random-0-28", "random-0-29", "random-0-30",
    "random-0-31", "random-0-32", "random-0-33", "random-0-34", "random-0-35", "random-0-36",
    "random-0-37", "random-0-38", "random-0-39"
  ]
  validation_shapes: [
    "random-0-40", "random-0-41", "random-0-42", "random-0-43", "random-0-44", "random-0-45",
    "random-0-46", "random-0-47", "random-0-48", "random-0-49"
  ]
  test_fraction: 0.2
  validation_fraction: 0.06
  pose { turned: 1 }
}
training_preset: "residual"
training {
  architecture { residual_convolutions { base_channels: 8 blocks: 1 } }
  output: POINT
  batch: 32
  learning_rate: 4e-3
  augmentation { mirror: true shift: 2 noise { min: 0.16 max: 0.16 } }
  spp: 8
}
shared_steps: 1000
steps: 100
rate_factor: 0.25
validate_every: 25
rerendering { images: 40 spp: 64 shown: 2 }
)";

// What the protocol of the paper has in common at all resolutions: the rest of `dataset`, and more.
constexpr std::string_view kPaperProtocol =
    R"(  shapes {
    builtin {
      names: [
        "figure", "dumbbell", "rounded_cube", "cube", "knot", "smooth_star",
        "gear",
        "mug", "mushroom", "goblet", "tree"
      ]
    }
  }
  validation_shapes: "gear"
  test_shapes: ["mug", "mushroom", "goblet", "tree"]
  materials {
    sampling: GRID
    sigma_t { one_of { value: [30, 36, 44, 54, 67, 82, 100, 122, 150, 184, 225, 276] } }
    albedo { one_of { value: [0.39, 0.59, 0.74, 0.87, 0.95] } }
    g { one_of { value: [0, 0.2, 0.4, 0.6, 0.8] } }
  }
}
other_noise_images: 400
training_preset: "paper"
rate_factor: 1
validate_every: 200
)";

constexpr std::string_view kPaperExperiment =
    R"(# The protocol of Che et al., ICCP 2020: 7,200 + 7,200 images of 128 x 128 pixels, 300 materials of a grid,
# 6 shapes with 4 suns to learn from and 4 shapes with 6 others to test with, their encoder, batches of 60,
# 50 epochs. Built-in shapes stand in for theirs, and one more validates; for
# other meshes, say shapes { folder { path: "meshes" } } and name them.
training {
  augmentation { noise { min: 0.1 max: 0.1 } }
  spp: 16
}
rate_search { rates: [3e-5, 1e-4, 3e-4] steps: 600 }
shared_steps: 0
steps: 6000
rerendering { images: 400 spp: 256 shown: 6 }
refinement { images: 40 spp: 64 max_spp: 1024 }
other_noise { target { target: 0.02 } }
dataset {
  resolution: 128
  noise { target: 0.05 }
)";

// What the preset paper is like with images of 64 x 64 pixels, but for its first comment.
constexpr std::string_view kSmallPaperExperiment =
    R"(# whose noise is higher, from which the encoder's six convolutions come down to one pixel, 10 epochs
# as an RN and 10 as what each network is, and 4 samples a pixel in the loss.
training {
  augmentation { noise { min: 0.28 max: 0.28 } }
  spp: 4
}
shared_steps: 1200
steps: 1200
rerendering { images: 100 spp: 64 shown: 6 }
other_noise { target { target: 0.07 } }
dataset {
  resolution: 64
  noise { target: 0.14 }
)";

// Refinements of the same images, from the networks that the paper has.
constexpr std::string_view kFiveStarts =
    R"(refinement {
  images: 40
  spp: 16
  max_spp: 64
  networks: ["RN+naive", "RN+similar", "ITN+naive", "ITN+similar", "ITN+similar+map"]
}
)";
constexpr std::string_view kAllStarts = "refinement { images: 40 spp: 16 max_spp: 64 }\n";

// A part of `dataset`.
constexpr std::string_view kRoughSurface =
    "  boundary { index { fixed: 1.4 } roughness { fixed: 0.25 } }\n";

std::string network(const std::string& name, const std::string& settings,
                    const std::string& rest = "") {
  return fmt::format("networks {{ name: \"{}\" settings {{ {} }} {} }}\n", name, settings, rest);
}

// RN and ITN of one parameterization, and an RN that takes as long.
std::string rn_and_itn() {
  return network("RN+similar", "loss: RN parameterization: SIMILARITY") +
         network("ITN+similar", "loss: ITN parameterization: SIMILARITY image_weights: UNIFORM") +
         network("RN+similar, time of ITN", "loss: RN parameterization: SIMILARITY",
                 "as_long_as: \"ITN+similar\"");
}

// RN and ITN once more, with other weights at the start and another order of the images.
std::string another_seed() {
  return network("RN+similar, seed 2", "loss: RN parameterization: SIMILARITY seed: 2") +
         network("ITN+similar, seed 2",
                 "loss: ITN parameterization: SIMILARITY image_weights: UNIFORM seed: 2");
}

// Networks that learn where few of the images have labels: renders need none.
std::string few_labels() {
  std::string file;
  for (const int labels : {60, 600}) {
    file += network(fmt::format("RN+similar, {} labels", labels),
                    fmt::format("loss: RN parameterization: SIMILARITY labels: {}", labels));
    file += network(
        fmt::format("ITN+similar, {} labels", labels),
        fmt::format("loss: ITN parameterization: SIMILARITY image_weights: UNIFORM labels: {}",
                    labels));
  }
  return file;
}

// RN and ITN from three seeds, the first with other weights of the image term, too.
std::string few_shapes_experiment() {
  constexpr int kSeeds = 3;
  std::string file(kFewShapesExperiment);
  const auto add = [&](const std::string& name, int seed, const std::string& settings,
                       const std::string& rest = "") {
    file += network(name, fmt::format("seed: {} {}", seed, settings), rest);
  };
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const auto named = [&](const char* kind) { return fmt::format("{}, {}", kind, seed); };
    add(named("RN+naive"), seed, "loss: RN parameterization: NAIVE");
    add(named("ITN+naive"), seed, "loss: ITN parameterization: NAIVE image_weights: UNIFORM");
    add(named("RN+naive, time of ITN"), seed, "loss: RN parameterization: NAIVE",
        fmt::format("as_long_as: \"{}\"", named("ITN+naive")));
  }
  for (const char* lambda : {"2", "10", "50"}) {
    add(fmt::format("ITN+naive, lambda {}", lambda), 1,
        fmt::format("loss: ITN parameterization: NAIVE image_weights: UNIFORM lambda: {}", lambda));
  }
  return file;
}

}  // namespace

std::span<const ExperimentPreset> experiment_presets() {
  const auto joined = [](std::initializer_list<std::string_view> parts) {
    return fmt::format("{}{}", fmt::join(parts, ""), kFiveNetworks);
  };
  static const std::array<std::string, 6> kFiles = {
      joined({kSmokeExperiment}),
      joined({kSmallExperiment}),
      joined({kPaperExperiment, kPaperProtocol}),
      few_shapes_experiment(),
      joined({"# The preset paper with images of 64 x 64 pixels,\n", kSmallPaperExperiment,
              kPaperProtocol, kFiveStarts}) +
          another_seed() + few_labels(),
      fmt::format("{}{}{}{}{}{}",
                  "# The preset paper_64 of objects with a rough surface, whose gloss the networks "
                  "see and the\n# renderer in the loss knows: images of 64 x 64 pixels,\n",
                  kSmallPaperExperiment, kRoughSurface, kPaperProtocol, kAllStarts, rn_and_itn())};
  static const std::array<ExperimentPreset, 7> kPresets = {{
      {"smoke", "whether everything works, in less than a minute", kFiles[0]},
      {"small", "results that mean something, in less than an hour on two cores", kFiles[1]},
      {"ablation", "what the image term is worth, by how it is made", kAblationExperiment},
      {"few_shapes", "what the image term is worth where shapes are few, with three seeds",
       kFiles[3]},
      {"paper_64",
       "the protocol of Che et al. 2020 at 64 pixels, and with few labels, in five hours",
       kFiles[4]},
      {"paper_64_gloss", "RN and ITN of it behind a rough surface, in three hours", kFiles[5]},
      {"paper", "the protocol of Che et al. 2020, in days", kFiles[2]},
  }};
  return kPresets;
}

const ExperimentPreset& find_experiment_preset(std::string_view name) {
  std::string names;
  for (const ExperimentPreset& preset : experiment_presets()) {
    if (preset.name == name) return preset;
    names += fmt::format("{}{}", names.empty() ? "" : ", ", preset.name);
  }
  throw invalid_input(fmt::format("there is no preset \"{}\"; there are {}", name, names));
}

}  // namespace itn
