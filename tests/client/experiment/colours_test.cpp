#include "client/experiment/colours.h"

#include <gtest/gtest.h>

#include <array>
#include <set>
#include <string>

namespace itn {
namespace {

DatasetPlan plan_of(int count) {
  DatasetPlan plan;
  for (int i = 0; i < count; ++i) {
    v1::DatasetItem& item = *plan.manifest.add_items();
    item.set_shape("shape_" + std::to_string(i));
    item.mutable_material()->set_sigma_t(30 + i);
    item.set_seed(static_cast<uint64_t>(i));
    item.set_file("images/" + std::to_string(i) + ".exr");
  }
  return plan;
}

TEST(Colours, AreThreeMaterialsInOneScene) {
  const std::array<uint32_t, 2> chosen = {1, 8};
  const DatasetPlan plan = colour_plan(plan_of(9), chosen);
  ASSERT_EQ(plan.manifest.items_size(), 6);
  std::set<std::string> files;
  std::set<uint64_t> seeds;
  for (int i = 0; i < 6; ++i) {
    const v1::DatasetItem& item = plan.manifest.items(i);
    EXPECT_EQ(item.shape(), i < 3 ? "shape_1" : "shape_8");
    files.insert(item.file());
    seeds.insert(item.seed());
  }
  EXPECT_EQ(files.size(), 6U);
  EXPECT_EQ(seeds.size(), 6U);
  const auto sigma_t = [&](int i) { return plan.manifest.items(i).material().sigma_t(); };
  EXPECT_EQ(sigma_t(0), 31);  // its own
  EXPECT_EQ(sigma_t(1), 34);
  EXPECT_EQ(sigma_t(2), 37);
  EXPECT_EQ(sigma_t(3), 38);
  EXPECT_EQ(sigma_t(4), 32);  // around the end
}

TEST(Colours, OfATestOfOneImageAreGray) {
  const std::array<uint32_t, 1> chosen = {0};
  const DatasetPlan plan = colour_plan(plan_of(1), chosen);
  ASSERT_EQ(plan.manifest.items_size(), 3);
  EXPECT_EQ(plan.manifest.items(2).material().sigma_t(), 30);
}

}  // namespace
}  // namespace itn
