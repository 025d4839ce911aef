#include "client/fit/disturbances.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "common/image/photograph.h"

namespace itn {
namespace {

using Plane = Eigen::VectorXd;

// Means over neighbours within the mask, the nearer ones counted more.
Plane smoothed(const Plane& plane, const std::vector<float>& mask, int width) {
  const int height = static_cast<int>(mask.size()) / width;
  Plane result = Plane::Zero(plane.size());
  const auto index = [width](int x, int y) { return Eigen::Index{y} * width + x; };
  const auto counts = [&](int x, int y) {
    return is_on_object(mask[static_cast<size_t>(index(x, y))]);
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double sum = 0, weights = 0;
      for (int v = std::max(0, y - 1); v <= std::min(height - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(width - 1, x + 1); ++u) {
          if (!counts(u, v)) continue;
          const double weight = (u == x ? 2.0 : 1.0) * (v == y ? 2.0 : 1.0);
          sum += weight * plane[index(u, v)];
          weights += weight;
        }
      }
      if (counts(x, y)) result[index(x, y)] = sum / weights;
    }
  }
  return result;
}

}  // namespace

std::vector<std::vector<float>> disturbances_of(std::span<const RenderedChange> changes,
                                                const std::vector<float>& mask, int width) {
  const auto pixels = static_cast<Eigen::Index>(mask.size());
  const size_t count = changes.front().more.size();
  const auto k = static_cast<double>(count);
  Plane mean = Plane::Zero(pixels);
  for (const RenderedChange& change : changes) {
    for (const auto* renders : {&change.more, &change.less}) {
      for (const std::vector<float>& estimate : *renders) {
        mean += Eigen::Map<const Eigen::VectorXf>(estimate.data(), pixels).cast<double>();
      }
    }
  }
  mean = smoothed(mean / (2 * k * static_cast<double>(changes.size())), mask, width);
  double on_object = 0, sum_of_mean = 0;
  for (Eigen::Index p = 0; p < pixels; ++p) {
    if (!is_on_object(mask[static_cast<size_t>(p)])) continue;
    ++on_object;
    sum_of_mean += mean[p];
  }
  constexpr double kDarkest = 0.02;  // of the mean: what is darker says nothing
  const double darkest = kDarkest * sum_of_mean / on_object;

  std::vector<std::vector<Plane>> relative;  // by change and estimate
  for (const RenderedChange& change : changes) {
    std::vector<Plane>& planes = relative.emplace_back();
    for (size_t e = 0; e < count; ++e) {
      Plane plane = Plane::Zero(pixels);
      for (Eigen::Index p = 0; p < pixels; ++p) {
        const auto i = static_cast<size_t>(p);
        if (!is_on_object(mask[i]) || mean[p] < darkest) continue;
        plane[p] =
            (double{change.more[e][i]} - double{change.less[e][i]}) / (change.apart * mean[p]);
      }
      planes.push_back(smoothed(smoothed(plane, mask, width), mask, width));
    }
  }
  // Products of different estimates, which are without bias.
  const auto n = static_cast<Eigen::Index>(changes.size());
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(n, n);
  std::vector<Plane> means;
  for (const std::vector<Plane>& planes : relative) {
    Plane& sum = means.emplace_back(Plane::Zero(pixels));
    for (const Plane& plane : planes) sum += plane / k;
  }
  for (size_t a = 0; a < changes.size(); ++a) {
    for (size_t b = 0; b < changes.size(); ++b) {
      double same = 0;
      for (size_t e = 0; e < count; ++e) same += relative[a][e].dot(relative[b][e]);
      products(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) =
          (k * k * means[a].dot(means[b]) - same) / (k * (k - 1) * on_object);
    }
  }
  // Independent errors of the same size may be turned into one another: those are taken that change
  // the image most.
  constexpr double kLeast = 0.002;
  constexpr Eigen::Index kMost = 5;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> turned(products);
  std::vector<std::vector<float>> planes;
  for (Eigen::Index i = n - 1; i >= std::max<Eigen::Index>(0, n - kMost); --i) {
    if (turned.eigenvalues()[i] < kLeast * kLeast) break;
    Plane sum = Plane::Zero(pixels);
    for (size_t e = 0; e < changes.size(); ++e) {
      sum += turned.eigenvectors()(static_cast<Eigen::Index>(e), i) * means[e];
    }
    const Eigen::VectorXf plane = sum.cast<float>();
    planes.emplace_back(plane.data(), plane.data() + plane.size());
  }
  return planes;
}

}  // namespace itn
