#include "common/material.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

TEST(Material, Coefficients) {
  const Material material{.sigma_t = 100, .albedo = 0.75, .g = 0.2};
  EXPECT_DOUBLE_EQ(material.sigma_s(), 75);
  EXPECT_DOUBLE_EQ(material.sigma_a(), 25);
  EXPECT_DOUBLE_EQ(material.sigma_s_reduced(), 60);
}

TEST(Material, LimitsAreAccepted) {
  validate({kMinSigmaT, 0, -kMaxAbsG});
  validate({kMaxSigmaT, 1, kMaxAbsG});
}

struct BadMaterial {
  const char* name;
  Material material;
  const char* message;
};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class BadMaterialTest : public ::testing::TestWithParam<BadMaterial> {};

TEST_P(BadMaterialTest, IsRefused) {
  testing::expect_error(ErrorKind::kInvalidInput, {GetParam().message},
                        [] { validate(GetParam().material); });
}

INSTANTIATE_TEST_SUITE_P(
    Table, BadMaterialTest,
    ::testing::Values(
        BadMaterial{"sigma_t_zero", {0, 0.5, 0}, "material.sigma_t is 0; it must be in [1e-06, "},
        BadMaterial{"sigma_t_negative", {-1, 0.5, 0}, "material.sigma_t is -1"},
        BadMaterial{"sigma_t_large", {1e7, 0.5, 0}, "material.sigma_t is 10000000"},
        BadMaterial{"sigma_t_nan", {kNan, 0.5, 0}, "material.sigma_t is nan"},
        BadMaterial{"albedo_large", {1, 1.2, 0}, "material.albedo is 1.2; it must be in [0, 1]"},
        BadMaterial{"albedo_negative", {1, -0.1, 0}, "material.albedo is -0.1"},
        BadMaterial{"albedo_nan", {1, kNan, 0}, "material.albedo is nan"},
        BadMaterial{"g_one", {1, 0.5, 1}, "material.g is 1; it must be in [-0.99, 0.99]"},
        BadMaterial{"g_minus_one", {1, 0.5, -1}, "material.g is -1"},
        BadMaterial{"g_nan", {1, 0.5, kNan}, "material.g is nan"}),
    [](const auto& row) { return std::string(row.param.name); });

}  // namespace
}  // namespace itn
