#include "client/refine/score_test.h"

#include <cmath>
#include <utility>

namespace itn {

ScoreTest::ScoreTest(ScoreEquations equations) : equations_(std::move(equations)) {}

Matrix ScoreTest::score_covariance(const Vector& step) const {
  const Eigen::Index all = equations_.gradient.size();
  Matrix sum = equations_.apart.size() > 0 ? equations_.apart : Matrix::Zero(all, all);
  for (const auto& [coordinates, sums] : equations_.moments) {
    const auto n = static_cast<Eigen::Index>(coordinates.size());
    // From the parts of s and H to those of s - H d, on both sides.
    const Vector d = step(coordinates);
    Matrix half(n, n + n * n), whole(n, n);
    for (Eigen::Index c = 0; c < n; ++c) {
      half.row(c) = sums.row(c) - d.transpose() * sums.middleRows(n + c * n, n);
    }
    for (Eigen::Index c = 0; c < n; ++c) {
      whole.col(c) = half.col(c) - half.middleCols(n + c * n, n) * d;
    }
    sum(coordinates, coordinates) += whole;
  }
  return sum;
}

ScoreTest::Solution ScoreTest::solved(const Matrix& score_covariance) const {
  const auto& [gradient, curvature, moments, apart, known, ridge] = equations_;
  if (known.empty()) {
    const Matrix back = curvature.inverse();
    return {back, back * score_covariance * back.transpose(), back * gradient};
  }
  const Matrix weighted = score_covariance.ldlt().solve(curvature).transpose();
  Matrix information = weighted * curvature;
  Vector sum = weighted * gradient;
  for (const auto& [coordinate, length, deviation] : known) {
    information(coordinate, coordinate) += 1 / (deviation * deviation);
    sum[coordinate] += length / (deviation * deviation);
  }
  const Matrix covariance = information.inverse();
  return {covariance * weighted, covariance, covariance * sum};
}

Vector ScoreTest::full_step() const {
  return solved(score_covariance(Vector::Zero(equations_.gradient.size()))).step;
}

Matrix ScoreTest::covariance() const {
  return solved(score_covariance(full_step())).covariance;
}

Matrix ScoreTest::covariance_of(const ScoreTest& part) const {
  const Vector step = full_step();
  const Matrix gain = solved(score_covariance(step)).gain;
  return gain * part.score_covariance(step) * gain.transpose();
}

double ScoreTest::statistic(const Vector& step) const {
  const Vector left = equations_.gradient - equations_.curvature * step;
  double sum = left.dot(score_covariance(step).inverse() * left);
  for (const auto& [coordinate, length, deviation] : equations_.known) {
    sum += std::pow((length - step[coordinate]) / deviation, 2);
  }
  return sum;
}

ScoreTest::Profile ScoreTest::profile(double along, double precision) const {
  // S changes little with the step: a few rounds find both.
  constexpr int kRounds = 3;
  const Eigen::Index n = equations_.gradient.size();
  Matrix others = equations_.curvature;
  others.col(ridge()).setZero();
  const Vector score = equations_.gradient - along * equations_.curvature.col(ridge());
  Profile profile{.statistic = 0, .step = Vector::Zero(n), .covariance = {}};
  profile.step[ridge()] = along;
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::LDLT<Eigen::MatrixXd> spread(score_covariance(profile.step));
    const Matrix weighted = spread.solve(others).transpose();
    Matrix information = weighted * others + precision * Matrix::Identity(n, n);
    Vector sum = weighted * score;
    for (const auto& [coordinate, length, deviation] : equations_.known) {
      information(coordinate, coordinate) += 1 / (deviation * deviation);
      sum[coordinate] += length / (deviation * deviation);
    }
    information.row(ridge()).setZero();
    information.col(ridge()).setZero();
    information(ridge(), ridge()) = 1;
    profile.covariance = information.inverse();
    profile.covariance(ridge(), ridge()) = 0;
    profile.step = profile.covariance * sum;
    const Vector left = score - others * profile.step;
    profile.step[ridge()] = along;
    profile.statistic = left.dot(spread.solve(left)) + precision * profile.step.squaredNorm();
    for (const auto& [coordinate, length, deviation] : equations_.known) {
      profile.statistic += std::pow((length - profile.step[coordinate]) / deviation, 2);
    }
  }
  return profile;
}

double ScoreTest::height(const Vector& step, double length) const {
  return statistic(step) + std::log(score_covariance(step).determinant()) +
         step.squaredNorm() / (length * length);
}

Vector ScoreTest::best_step(double length) const {
  constexpr int kIntervals = 40, kThirds = 16;
  const auto step = [&](double along) { return profile(along, 1 / (length * length)).step; };
  const auto height_at = [&](double along) { return height(step(along), length); };
  // The lowest of some points, and then the lowest between its neighbours.
  const double spacing = 2 * length / kIntervals;
  double lowest = 0, least = height_at(0);
  for (int i = 0; i <= kIntervals; ++i) {
    const double along = i * spacing - length, here = height_at(along);
    if (here < least) {
      least = here;
      lowest = along;
    }
  }
  double low = lowest - spacing, high = lowest + spacing;
  for (int i = 0; i < kThirds; ++i) {
    const double third = (high - low) / 3;
    if (height_at(low + third) < height_at(high - third)) {
      high -= third;
    } else {
      low += third;
    }
  }
  return step((low + high) / 2);
}

}  // namespace itn
