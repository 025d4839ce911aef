#include "common/learning/parameterization.h"

#include <cmath>

#include <gmock/gmock.h>

#include "common/error.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {
namespace {

const v1::Parameterization kAll[] = {v1::NAIVE, v1::SIMILARITY, v1::UNBOUNDED};
const Material kMaterials[] = {
    {30, 0.39, 0}, {100, 0.87, 0.4}, {276, 0.95, 0.8}, {50, 0.6, -0.05}, {200, 0.74, 0.2}};

MaterialCoordinates as_triple(const Material& m) {
  return {m.sigma_t, m.albedo, m.g};
}

TEST(Parameterization, IsInvertedExactly) {
  for (const auto parameterization : kAll) {
    for (const Material& m : kMaterials) {
      const Material back = from_coordinates(parameterization, to_coordinates(parameterization, m));
      EXPECT_NEAR(back.sigma_t, m.sigma_t, 1e-12 * m.sigma_t);
      EXPECT_NEAR(back.albedo, m.albedo, 1e-14);
      EXPECT_NEAR(back.g, m.g, 1e-14);
    }
  }
}

TEST(Parameterization, ReducedCoordinatesKeepAbsorptionAndReducedScattering) {
  for (const Material& m : kMaterials) {
    const MaterialCoordinates c = to_coordinates(v1::SIMILARITY, m);
    const Material isotropic{c[0], c[1], 0};
    EXPECT_NEAR(isotropic.sigma_a(), m.sigma_a(), 1e-12 * m.sigma_t);
    EXPECT_NEAR(isotropic.sigma_s(), m.sigma_s_reduced(), 1e-12 * m.sigma_t);
  }
}

TEST(Parameterization, SimilarMediaDifferInTheLastCoordinateOnly) {
  // Same sigma_a and sigma_s (1 - g): 5 and 30.
  const Material a{35, 30.0 / 35, 0}, b{65, 60.0 / 65, 0.5};
  const MaterialCoordinates ca = to_coordinates(v1::SIMILARITY, a),
                            cb = to_coordinates(v1::SIMILARITY, b);
  EXPECT_NEAR(ca[0], cb[0], 1e-12);
  EXPECT_NEAR(ca[1], cb[1], 1e-12);
  EXPECT_NE(ca[2], cb[2]);
}

TEST(Parameterization, JacobianAgreesWithFiniteDifferences) {
  for (const auto parameterization : kAll) {
    for (const Material& m : kMaterials) {
      const MaterialCoordinates c = to_coordinates(parameterization, m);
      const Jacobian j = jacobian(parameterization, c);
      for (size_t k = 0; k < 3; ++k) {
        const double h = 1e-6 * std::max(1.0, std::abs(c[k]));
        MaterialCoordinates up = c, down = c;
        up[k] += h;
        down[k] -= h;
        const MaterialCoordinates high = as_triple(from_coordinates(parameterization, up));
        const MaterialCoordinates low = as_triple(from_coordinates(parameterization, down));
        for (size_t i = 0; i < 3; ++i) {
          const double expected = (high[i] - low[i]) / (2 * h);
          EXPECT_NEAR(j[i][k], expected, 1e-7 * (1 + std::abs(expected))) << i << ", " << k;
        }
      }
    }
  }
}

TEST(PredictionBounds, OfThePapersRangesAreThePapersClamps) {
  const Box box = to_box(prediction_bounds(paper_range()));
  const MaterialCoordinates min{20, 0.35, -0.1}, max{300, 0.97, 0.9};
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(box.min[i], min[i], 1e-12);
    EXPECT_NEAR(box.max[i], max[i], 1e-12);
  }
}

TEST(PredictionBounds, TellTheTrainingRange) {
  const Box back = to_box(training_range(prediction_bounds(paper_range())));
  const Box range = to_box(paper_range());
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(back.min[i], range.min[i], 1e-9);
    EXPECT_NEAR(back.max[i], range.max[i], 1e-9);
  }
}

// Of materials that absorb next to nothing the network can say so.
TEST(PredictionBounds, ReachTheBrightestOfTheTraining) {
  v1::MaterialRange range = paper_range();
  range.mutable_albedo()->set_max(0.99);
  EXPECT_EQ(prediction_bounds(range).albedo().max(), 0.999);
  range.mutable_albedo()->set_max(0.9999);
  const v1::MaterialRange bounds = prediction_bounds(range);
  EXPECT_EQ(bounds.albedo().max(), 0.9999);
  EXPECT_EQ(training_range(bounds).albedo().max(), 0.9999);
}

TEST(AnswerSpace, HasTheChannelsBesideEachOther) {
  v1::Model model = small_model(v1::UNBOUNDED);
  const OutputSpace gray(model);
  model.set_channels(2);
  EXPECT_THROW(AnswerSpace{model}, Error);
  model.set_channels(3);
  EXPECT_THROW(AnswerSpace{model}, Error);  // three numbers are too few
  for (int i = 3; i < 7; ++i) {
    model.add_mean(0.1 * i);
    model.add_standard_deviation(1 + 0.1 * i);
  }
  const AnswerSpace space(model);
  EXPECT_EQ(space.size(), 7);
  const std::vector<Material> materials{{50, 0.6, 0.3}, {70, 0.8, 0.3}, {90, 0.9, 0.3}};
  const std::vector<double> numbers = space.standardized(materials);
  ASSERT_EQ(numbers.size(), 7);
  const std::vector<Material> back = space.materials(numbers);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(back[c].sigma_t, materials[c].sigma_t, 1e-9);
    EXPECT_NEAR(back[c].albedo, materials[c].albedo, 1e-12);
    EXPECT_NEAR(back[c].g, materials[c].g, 1e-12);
  }
  // The first coordinate of red is the first of all, in its own unit.
  EXPECT_DOUBLE_EQ(numbers[0], gray.standardized(materials[0])[0]);
  model.set_parameterization(v1::SIMILARITY);
  EXPECT_THROW(AnswerSpace{model}, Error);
}

TEST(OutputSpace, StandardizedIsUndoneByMaterial) {
  for (const auto parameterization : kAll) {
    const OutputSpace space(small_model(parameterization));
    for (const Material& m : kMaterials) {
      const Material back = space.material(space.standardized(m));
      EXPECT_NEAR(back.sigma_t, m.sigma_t, 1e-9);
      EXPECT_NEAR(back.albedo, m.albedo, 1e-12);
      EXPECT_NEAR(back.g, m.g, 1e-12);
    }
  }
}

TEST(OutputSpace, KeepsAnyOutputInsideItsBounds) {
  const Box box = to_box(small_model().bounds());
  for (const auto parameterization : kAll) {
    const OutputSpace space(small_model(parameterization));
    for (const double a : {-1e9, -30., -3., 0., 3., 30., 1e9}) {
      for (const double b : {-1e9, -30., -3., 0., 3., 30., 1e9}) {
        for (const double c : {-1e9, -30., -3., 0., 3., 30., 1e9}) {
          const MaterialCoordinates m = as_triple(space.material({a, b, c}));
          for (size_t i = 0; i < 3; ++i) {
            EXPECT_GE(m[i], box.min[i]);
            EXPECT_LE(m[i], box.max[i]);
          }
        }
      }
    }
  }
}

// A smooth loss with a minimum inside the bounds.
double loss(const Material& m) {
  return std::pow((m.sigma_t - 90) / 50, 2) + std::pow((m.albedo - 0.8) / 0.2, 2) + m.g * m.albedo;
}
MaterialCoordinates loss_gradient(const Material& m) {
  return {2 * (m.sigma_t - 90) / 2500, 2 * (m.albedo - 0.8) / 0.04 + m.g, m.albedo};
}

TEST(OutputSpace, GradientAgreesWithFiniteDifferencesInside) {
  for (const auto parameterization : kAll) {
    const OutputSpace space(small_model(parameterization));
    for (const Material& m : kMaterials) {
      const MaterialCoordinates z = space.standardized(m);
      const MaterialCoordinates gradient = space.output_gradient(z, loss_gradient(m));
      for (size_t k = 0; k < 3; ++k) {
        constexpr double kStep = 1e-5;
        MaterialCoordinates up = z, down = z;
        up[k] += kStep;
        down[k] -= kStep;
        const double expected =
            (loss(space.material(up)) - loss(space.material(down))) / (2 * kStep);
        EXPECT_NEAR(gradient[k], expected, 1e-6 * (1 + std::abs(expected)));
      }
    }
  }
}

TEST(OutputSpace, GradientBeyondABoundPullsBackButDoesNotPushOut) {
  const OutputSpace space(small_model(v1::NAIVE));
  const MaterialCoordinates above = space.standardized({1000, 0.7, 0.4});
  EXPECT_GT(space.output_gradient(above, {1, 0, 0})[0], 0);   // descent lowers sigma_t
  EXPECT_EQ(space.output_gradient(above, {-1, 0, 0})[0], 0);  // descent would raise it
  const MaterialCoordinates below = space.standardized({1, 0.7, 0.4});
  EXPECT_LT(space.output_gradient(below, {-1, 0, 0})[0], 0);
  EXPECT_EQ(space.output_gradient(below, {1, 0, 0})[0], 0);
}

TEST(OutputSpace, RefusesAModelWithoutItsNumbers) {
  v1::Model model = small_model();
  model.clear_mean();
  EXPECT_THROW(OutputSpace{model}, Error);
  model = small_model();
  model.set_standard_deviation(1, 0);
  EXPECT_THROW(OutputSpace{model}, Error);
  model = small_model();
  model.mutable_bounds()->mutable_g()->set_max(1);
  EXPECT_THROW(OutputSpace{model}, Error);
}

TEST(OutputSpace, RefusesAPredictionThatIsNotFinite) {
  const OutputSpace space(small_model());
  EXPECT_THROW(space.material({NAN, 0, 0}), Error);
}

}  // namespace
}  // namespace itn
