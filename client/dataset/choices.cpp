#include "client/dataset/choices.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "client/dataset/distribution.h"
#include "client/dataset/sampler.h"
#include "common/low_discrepancy.h"

namespace itn {
namespace {

// A permutation of 0 .. count-1 that a seed selects, at one place: a Feistel network over the next
// power of four, walked until it comes back into the range (Black and Rogaway, "Ciphers with
// arbitrary finite domains", 2002).
uint64_t permuted(uint64_t place, uint64_t count, uint64_t seed) {
  const int half = std::max(1, static_cast<int>(std::bit_width(count - 1) + 1) / 2);
  const uint64_t mask = (uint64_t{1} << half) - 1;
  do {
    uint64_t left = place >> half, right = place & mask;
    for (uint64_t round = 0; round < 6; ++round) {
      left ^= derive_seed(seed, {round, right}) & mask;
      std::swap(left, right);
    }
    place = left << half | right;
  } while (place >= count);
  return place;
}

}  // namespace

uint64_t part_of(double fraction, uint64_t count) {
  return static_cast<uint64_t>(std::floor(fraction * static_cast<double>(count) + 0.5));
}

ItemPlace place_of(const v1::DatasetConfig& config, uint64_t index) {
  const uint64_t test = part_of(config.test_fraction(), index);
  if (part_of(config.test_fraction(), index + 1) > test) return {v1::SPLIT_TEST, test};
  const uint64_t rest = index - test;
  const double fraction = config.validation_fraction() / (1 - config.test_fraction());
  const uint64_t validation = part_of(fraction, rest);
  if (part_of(fraction, rest + 1) > validation) return {v1::SPLIT_VALIDATION, validation};
  return {v1::SPLIT_TRAIN, rest - validation};
}

double Choices::number(uint64_t choice) const {
  constexpr uint64_t kStrata = 64;
  return (static_cast<double>(in_turn(choice, kStrata)) + random(choice).uniform()) / kStrata;
}

float Choices::draw(uint64_t choice, const v1::Distribution& distribution) const {
  const auto& list = distribution.one_of().value();
  return static_cast<float>(
      list.empty() ? quantile(distribution, number(choice))
                   : list[static_cast<int>(in_turn(choice, static_cast<uint64_t>(list.size())))]);
}

std::array<double, 3> Choices::point(uint64_t choice) const {
  SplitMix scrambles(derive_seed(seed_, {choice, index_ >> 32}));
  std::array<double, 3> result;
  std::ranges::transform(
      sobol_point(static_cast<uint32_t>(index_)), result.begin(), [&](uint32_t coordinate) {
        return owen_scrambled(coordinate, static_cast<uint32_t>(scrambles.next())) * 0x1p-32;
      });
  return result;
}

uint64_t Choices::in_turn(uint64_t choice, uint64_t count) const {
  return permuted(index_ % count, count, derive_seed(seed_, {choice, index_ / count}));
}

size_t weighted(std::span<const double> weights, double u) {
  double sum = 0;
  for (const double weight : weights) sum += weight;
  u *= sum;
  size_t last = 0;  // with a weight
  for (size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] == 0) continue;
    last = i;
    if (u < weights[i]) break;
    u -= weights[i];
  }
  return last;
}

}  // namespace itn
