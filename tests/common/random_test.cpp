#include "common/random.h"

#include <gtest/gtest.h>

#include <set>

namespace itn {
namespace {

TEST(DerivedSeeds, DifferByEveryStepOfThePath) {
  std::set<uint64_t> seeds;
  for (uint64_t a = 0; a < 30; ++a) {
    for (uint64_t b = 0; b < 30; ++b) {
      seeds.insert(derive_seed(1, {a, b}));
      seeds.insert(derive_seed(2, {a, b}));
    }
    seeds.insert(derive_seed(1, {a}));
  }
  EXPECT_EQ(seeds.size(), 2 * 900 + 30);
}

TEST(SplitMix, IsTheReferenceGenerator) {
  // First outputs for state 1234567, as the reference implementation prints them.
  SplitMix random(1234567);
  EXPECT_EQ(random.next(), 6457827717110365317U);
  EXPECT_EQ(random.next(), 3203168211198807973U);
}

}  // namespace
}  // namespace itn
