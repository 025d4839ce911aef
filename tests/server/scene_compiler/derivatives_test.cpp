#include "server/scene_compiler/derivatives.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "common/error.h"

namespace itn {
namespace {

// Any smooth function of the material will do.
double f(const Material& m) {
  return std::sin(m.sigma_t) * std::exp(2 * m.albedo) + m.g * m.sigma_t;
}

std::array<double, 3> gradient(const Material& m) {
  return {std::cos(m.sigma_t) * std::exp(2 * m.albedo) + m.g,
          2 * std::sin(m.sigma_t) * std::exp(2 * m.albedo), m.sigma_t};
}

Material from_absorption_and_scattering(double sigma_a, double sigma_s, double g) {
  return {sigma_a + sigma_s, sigma_s / (sigma_a + sigma_s), g};
}

struct Row {
  v1::Parameter parameter;
  // The material whose `parameter` is larger by h, its other coordinates the same.
  std::function<Material(const Material&, double h)> moved;
};

class ChainRuleOf : public ::testing::TestWithParam<Row> {};

TEST_P(ChainRuleOf, EqualsTheFiniteDifference) {
  for (const Material m : {Material{1.3, 0.7, 0.4}, Material{0.2, 0.05, -0.8}, Material{5, 1, 0}}) {
    const auto weights = chain_rule(GetParam().parameter, m);
    const auto d = gradient(m);
    const double h = 1e-5;
    const double difference = (f(GetParam().moved(m, h)) - f(GetParam().moved(m, -h))) / (2 * h);
    EXPECT_NEAR(weights[0] * d[0] + weights[1] * d[1] + weights[2] * d[2], difference, 1e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(AllParameters, ChainRuleOf,
                         ::testing::Values(Row{v1::SIGMA_T,
                                               [](Material m, double h) {
                                                 return Material{m.sigma_t + h, m.albedo, m.g};
                                               }},
                                           Row{v1::ALBEDO,
                                               [](Material m, double h) {
                                                 return Material{m.sigma_t, m.albedo + h, m.g};
                                               }},
                                           Row{v1::G,
                                               [](Material m, double h) {
                                                 return Material{m.sigma_t, m.albedo, m.g + h};
                                               }},
                                           Row{v1::SIGMA_A,
                                               [](Material m, double h) {
                                                 return from_absorption_and_scattering(
                                                     m.sigma_a() + h, m.sigma_s(), m.g);
                                               }},
                                           Row{v1::SIGMA_S,
                                               [](Material m, double h) {
                                                 return from_absorption_and_scattering(
                                                     m.sigma_a(), m.sigma_s() + h, m.g);
                                               }},
                                           Row{v1::SIGMA_S_REDUCED,
                                               [](Material m, double h) {
                                                 const double sigma_s =
                                                     (m.sigma_s_reduced() + h) / (1 - m.g);
                                                 return from_absorption_and_scattering(
                                                     m.sigma_a(), sigma_s, m.g);
                                               }}),
                         [](const auto& row) { return v1::Parameter_Name(row.param.parameter); });

TEST(ChainRule, RefusesWhatIsNoParameter) {
  EXPECT_THROW(chain_rule(v1::PARAMETER_UNSPECIFIED, {}), Error);
  EXPECT_THROW(chain_rule(static_cast<v1::Parameter>(99), {}), Error);
}

}  // namespace
}  // namespace itn
