// The random choices of a dataset's items.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "common/random.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// Branches of the tree of random choices below a dataset's seed. The order is part of what a
// dataset is: new ones come last.
enum Choice : uint64_t {
  kSplitChoice,
  kShape,
  kMaterial,
  kPoseKind,
  kRotation,
  kPitch,
  kDistance,
  kObjectSize,
  kOffsetX,
  kOffsetY,
  kLightKind,
  kLight,
  kGround,
  kReflectance,
  kRenderSeed,
  kPanoramaSplit,
  kBoundary,
  kCheckerboard,
  kChannel,
  kTexture,
  kColours,
  kGroundColor,
  kTemperature
};

// The place of an item in its split.
struct ItemPlace {
  v1::Split split;
  uint64_t index;  // among the items of this split
};

// How many of the first `count` items are of a kind that has this part of them: the nearest number.
uint64_t part_of(double fraction, uint64_t count);

// Splits come in turn as evenly as their fractions allow: first what is of the test, then, of the
// rest, what is of the validation.
ItemPlace place_of(const v1::DatasetConfig& config, uint64_t index);

// The choices of one item. `choice`: a branch of the tree, a Choice or derive_seed() of one.
class Choices {
 public:
  Choices(const v1::DatasetConfig& config, ItemPlace place)
      : seed_(derive_seed(config.seed(), {static_cast<uint64_t>(place.split)})),
        index_(place.index) {}

  // In [0, 1). Stretches of 64 items have one in each 64th, in an order that knows nothing of other
  // choices. (Points of a sequence, shuffled for each choice as renderers do, would be spread more
  // evenly yet, but neighbours go together from choice to choice, which a chi-square test sees.)
  double number(uint64_t choice) const;

  // A number of the distribution: by number(), or of a list, whose entries come in turn.
  float draw(uint64_t choice, const v1::Distribution& distribution) const;

  // Three numbers in [0, 1) that are spread evenly together: Owen-scrambled Sobol points.
  std::array<double, 3> point(uint64_t choice) const;

  // A number below `count`, which is 1 at least: all of them come in an order of this choice's own,
  // then again in another.
  uint64_t in_turn(uint64_t choice, uint64_t count) const;

  // Independent uniform numbers in [0, 1).
  SplitMix random(uint64_t choice) const { return SplitMix(derive_seed(seed_, {choice, index_})); }

 private:
  uint64_t seed_;
  uint64_t index_;
};

// The number of the weight that `u` in [0, 1) falls on. Weights are >= 0, and not all 0.
size_t weighted(std::span<const double> weights, double u);

}  // namespace itn
