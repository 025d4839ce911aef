#include "client/refine/score_test.h"

#include <cmath>
#include <utility>

namespace itn {

ScoreTest::ScoreTest(Matrix curvature, Vector gradient, Matrix moments)
    : curvature_(std::move(curvature)),
      gradient_(std::move(gradient)),
      moments_(std::move(moments)) {}

Matrix ScoreTest::score_covariance(const Vector& step) const {
  const Eigen::Index n = gradient_.size();
  // From the parts of s and H to those of s - H d.
  Matrix after = Matrix::Zero(n, n + n * n);
  for (Eigen::Index c = 0; c < n; ++c) {
    after(c, c) = 1;
    after.block(c, n + c * n, 1, n) = -step.transpose();
  }
  return after * moments_ * after.transpose();
}

Vector ScoreTest::full_step() const {
  return curvature_.inverse() * gradient_;
}

Matrix ScoreTest::covariance() const {
  const Matrix back = curvature_.inverse();
  return back * score_covariance(full_step()) * back.transpose();
}

double ScoreTest::statistic(const Vector& step) const {
  const Vector left = gradient_ - curvature_ * step;
  return left.dot(score_covariance(step).inverse() * left);
}

ScoreTest::Profile ScoreTest::profile(double along, double precision) const {
  // S changes little with the step: a few rounds find both.
  constexpr int kRounds = 3;
  const Eigen::Index n = gradient_.size();
  Matrix others = curvature_;
  others.col(kRidge).setZero();
  const Vector score = gradient_ - along * curvature_.col(kRidge);
  Profile profile{.statistic = 0, .step = Vector::Zero(n), .covariance = {}};
  profile.step[kRidge] = along;
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::LDLT<Eigen::MatrixXd> spread(score_covariance(profile.step));
    const Matrix weighted = spread.solve(others).transpose();
    Matrix information = weighted * others + precision * Matrix::Identity(n, n);
    information.row(kRidge).setZero();
    information.col(kRidge).setZero();
    information(kRidge, kRidge) = 1;
    profile.covariance = information.inverse();
    profile.covariance(kRidge, kRidge) = 0;
    profile.step = profile.covariance * (weighted * score);
    const Vector left = score - others * profile.step;
    profile.step[kRidge] = along;
    profile.statistic = left.dot(spread.solve(left)) + precision * profile.step.squaredNorm();
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
