#include "client/refine/likeness.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace itn {

double likeness_at(double squared_distance) {
  constexpr double kFar = 4;  // lengths: beyond, nothing is alike
  return squared_distance < kFar * kFar ? std::exp(-squared_distance / 2) : 0;
}

AlikePixels::AlikePixels(std::span<const uint32_t> pixels, uint32_t width,
                         const Likeness& likeness) {
  const auto side = std::max(1U, static_cast<uint32_t>(likeness.length / 2));
  struct Square {
    double x = 0, y = 0, pixels = 0;
  };
  std::map<std::pair<uint32_t, uint32_t>, Eigen::Index> numbers;
  std::vector<Square> squares;
  for (const uint32_t p : pixels) {
    const uint32_t x = p % width, y = p / width;
    const auto [place, is_new] = numbers.try_emplace({y / side, x / side}, std::ssize(squares));
    if (is_new) squares.emplace_back();
    Square& square = squares[static_cast<size_t>(place->second)];
    square.x += x;
    square.y += y;
    ++square.pixels;
    squares_.push_back(place->second);
  }
  covariance_.resize(std::ssize(squares), std::ssize(squares));
  for (size_t a = 0; a < squares.size(); ++a) {
    for (size_t b = 0; b < squares.size(); ++b) {
      const double x = squares[a].x / squares[a].pixels - squares[b].x / squares[b].pixels;
      const double y = squares[a].y / squares[a].pixels - squares[b].y / squares[b].pixels;
      covariance_(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) =
          likeness.size * likeness.size *
          likeness_at((x * x + y * y) / (likeness.length * likeness.length));
    }
  }
}

void AlikePixels::weigh(std::span<const double> weights, std::span<const double> radiance,
                        std::span<std::vector<double>> planes) const {
  const size_t count = squares_.size();
  const Eigen::Index squares = covariance_.rows();
  // With W of the weights, G of the radiance by pixel and square, and S of the parts, the inverse
  // is
  //   W - W G (S - S r (1 + r S r)^-1 r S) G' W,   r^2 = G' W G.
  Vector root = Vector::Zero(squares);
  for (size_t i = 0; i < count; ++i) root[squares_[i]] += weights[i] * radiance[i] * radiance[i];
  root = root.cwiseSqrt();
  Eigen::MatrixXd inner = root.asDiagonal() * covariance_ * root.asDiagonal();
  inner.diagonal().array() += 1;
  const Eigen::LLT<Eigen::MatrixXd> solver(inner);
  for (std::vector<double>& plane : planes) {
    Vector sums = Vector::Zero(squares);
    for (size_t i = 0; i < count; ++i) sums[squares_[i]] += weights[i] * radiance[i] * plane[i];
    const Vector spread = covariance_ * sums;
    const Vector solved = solver.solve(root.cwiseProduct(spread));
    const Vector shared = spread - covariance_ * root.cwiseProduct(solved);
    for (size_t i = 0; i < count; ++i) {
      plane[i] = weights[i] * (plane[i] - radiance[i] * shared[squares_[i]]);
    }
  }
}

}  // namespace itn
