#include "client/fit/disturbances.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "common/image/photograph.h"

namespace itn {
namespace {

using Plane = Eigen::VectorXd;

// The pixels of one colour that count.
struct SeenPixels {
  std::vector<size_t> pixels;  // of the renders
  Plane mean;                  // radiance, over all renders
};

SeenPixels seen_pixels(std::span<const RenderedChange> changes, const std::vector<float>& mask,
                       size_t colour) {
  constexpr double kDarkest = 0.02;  // of the mean: what is darker says nothing
  std::vector<size_t> on_object;
  std::vector<double> mean;
  double sum = 0;
  for (size_t p = 0; p < mask.size(); ++p) {
    if (!is_on_object(mask[p])) continue;
    on_object.push_back(colour * mask.size() + p);
    double radiance = 0, renders = 0;
    for (const RenderedChange& change : changes) {
      for (const auto* estimates : {&change.more, &change.less}) {
        for (const std::vector<float>& estimate : *estimates) {
          radiance += double{estimate[on_object.back()]};
          ++renders;
        }
      }
    }
    mean.push_back(radiance / renders);
    sum += mean.back();
  }
  const double darkest = kDarkest * sum / static_cast<double>(mean.size());
  SeenPixels seen;
  std::vector<double> bright;
  for (size_t i = 0; i < mean.size(); ++i) {
    if (mean[i] <= darkest) continue;
    seen.pixels.push_back(on_object[i]);
    bright.push_back(mean[i]);
  }
  seen.mean = Eigen::Map<const Plane>(bright.data(), std::ssize(bright));
  return seen;
}

// All products of at most `degree` of the columns.
Eigen::MatrixXd monomials(const Eigen::MatrixXd& variables, int degree) {
  std::vector<Plane> columns{Plane::Ones(variables.rows())};
  // By variable, where the products of the degree before with it and those after it begin.
  std::vector<size_t> first(static_cast<size_t>(variables.cols()), 0);
  size_t end = 1;
  for (int d = 0; d < degree; ++d) {
    for (Eigen::Index v = 0; v < variables.cols(); ++v) {
      const size_t begin = std::exchange(first[static_cast<size_t>(v)], columns.size());
      for (size_t i = begin; i < end; ++i) {
        const Plane product = columns[i].cwiseProduct(variables.col(v));
        columns.push_back(product);
      }
    }
    end = columns.size();
  }
  Eigen::MatrixXd result(variables.rows(), std::ssize(columns));
  for (size_t i = 0; i < columns.size(); ++i) {
    result.col(static_cast<Eigen::Index>(i)) = columns[i];
  }
  return result;
}

// How the radiance rises along a row and down a column, as a part of it in a pixel, by Sobel's
// operator over pixels that count. Noise of a pixel itself is not in it.
Eigen::MatrixXd slopes(const SeenPixels& seen, size_t pixels, int width) {
  const int height = static_cast<int>(pixels) / width;
  std::vector<Eigen::Index> place(pixels, -1);
  for (size_t i = 0; i < seen.pixels.size(); ++i) {
    place[seen.pixels[i] % pixels] = static_cast<Eigen::Index>(i);
  }
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(seen.mean.size(), 2);
  for (Eigen::Index i = 0; i < seen.mean.size(); ++i) {
    const auto pixel = static_cast<int>(seen.pixels[static_cast<size_t>(i)] % pixels);
    const auto seen_at = [&](int dx, int dy) {
      const int x = pixel % width + dx, y = pixel / width + dy;
      if (x < 0 || x >= width || y < 0 || y >= height) return Eigen::Index{-1};
      return place[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
    };
    for (int beside = -1; beside <= 1; ++beside) {
      const double weight = (beside == 0 ? 2 : 1) / (8 * seen.mean[i]);
      const auto rise = [&](Eigen::Index from, Eigen::Index to) {
        return from < 0 || to < 0 ? 0 : weight * (seen.mean[to] - seen.mean[from]);
      };
      result(i, 0) += rise(seen_at(-1, beside), seen_at(1, beside));
      result(i, 1) += rise(seen_at(beside, -1), seen_at(beside, 1));
    }
  }
  return result;
}

// Polynomials over the pixels of a colour, of degrees 0, 1, ...: an orthonormal basis of each.
// Pixels count by their radiance, as the variance of its relative changes is about as its inverse.
class Polynomials {
 public:
  Polynomials(const SeenPixels& seen, size_t pixels, std::span<const std::vector<float>> surface)
      : root_weights_(seen.mean.cwiseSqrt()) {
    Eigen::MatrixXd variables(seen.mean.size(), std::ssize(surface));
    for (Eigen::Index p = 0; p < variables.rows(); ++p) {
      for (size_t v = 0; v < surface.size(); ++v) {
        variables(p, static_cast<Eigen::Index>(v)) =
            double{surface[v][seen.pixels[static_cast<size_t>(p)] % pixels]};
      }
    }
    for (auto column : variables.colwise()) {
      column.array() -= column.mean();
      column /= std::max(std::sqrt(column.squaredNorm() / static_cast<double>(column.size())),
                         std::numeric_limits<double>::min());
    }
    constexpr int kMostDegree = 3;
    constexpr Eigen::Index kPixelsPerTerm = 8;
    for (int degree = 0; degree <= kMostDegree; ++degree) {
      const Eigen::MatrixXd terms = root_weights_.asDiagonal() * monomials(variables, degree);
      if (degree > 0 && terms.cols() * kPixelsPerTerm > terms.rows()) break;
      Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(terms);
      constexpr double kDependent = 1e-6;
      qr.setThreshold(kDependent);
      bases_.push_back(qr.householderQ() * Eigen::MatrixXd::Identity(terms.rows(), qr.rank()));
    }
  }

  // What is smooth in each of some independent estimates of the same. The degree makes the error of
  // their mean least: what it leaves out of the truth, whose square is that of the truth but for a
  // part which products of different estimates tell without bias, and what noise it lets through.
  std::vector<Plane> smoothed(const std::vector<Plane>& estimates) const {
    const auto count = static_cast<double>(estimates.size());
    double least = std::numeric_limits<double>::infinity();
    const Eigen::MatrixXd* basis = nullptr;
    for (const Eigen::MatrixXd& one : bases_) {
      Plane sum = Plane::Zero(one.cols());
      double same = 0;
      for (const Plane& estimate : estimates) {
        const Plane parts = one.transpose() * root_weights_.cwiseProduct(estimate);
        sum += parts;
        same += parts.squaredNorm();
      }
      const double told = (sum.squaredNorm() - same) / (count * (count - 1));
      const double noise = (same / count - told) / count;
      if (noise - told < least) {
        least = noise - told;
        basis = &one;
      }
    }
    std::vector<Plane> result;
    result.reserve(estimates.size());
    for (const Plane& estimate : estimates) {
      result.emplace_back((*basis * (basis->transpose() * root_weights_.cwiseProduct(estimate)))
                              .cwiseQuotient(root_weights_));
    }
    return result;
  }

 private:
  const Plane root_weights_;
  std::vector<Eigen::MatrixXd> bases_;
};

// What a change that moves the image does to it, of a standard deviation.
Plane changed_by_motion(const RenderedChange& change, const SeenPixels& seen, size_t pixels,
                        const Eigen::MatrixXd& slope) {
  Plane result = Plane::Zero(seen.mean.size());
  if (change.motion.empty()) return result;
  for (Eigen::Index p = 0; p < result.size(); ++p) {
    const auto& [x, y] = change.motion[seen.pixels[static_cast<size_t>(p)] % pixels];
    result[p] = -(slope(p, 0) * double{x} + slope(p, 1) * double{y});
  }
  return result;
}

// What a standard deviation adds, as a part of the radiance, by change and estimate.
std::vector<std::vector<Plane>> relative_changes(std::span<const RenderedChange> changes,
                                                 const std::vector<float>& mask, int width,
                                                 std::span<const std::vector<float>> surface) {
  const size_t count = changes.front().more.size(), size = changes.front().more.front().size();
  std::vector<std::vector<Plane>> relative(
      changes.size(), std::vector<Plane>(count, Plane::Zero(static_cast<Eigen::Index>(size))));
  for (size_t colour = 0; colour < size / mask.size(); ++colour) {
    const SeenPixels seen = seen_pixels(changes, mask, colour);
    if (seen.pixels.empty()) continue;
    const Polynomials polynomials(seen, mask.size(), surface);
    const Eigen::MatrixXd slope = slopes(seen, mask.size(), width);
    for (size_t c = 0; c < changes.size(); ++c) {
      const Plane by_motion = changed_by_motion(changes[c], seen, mask.size(), slope);
      std::vector<Plane> besides(count, -by_motion);
      for (size_t e = 0; e < count; ++e) {
        for (Eigen::Index p = 0; p < seen.mean.size(); ++p) {
          const size_t i = seen.pixels[static_cast<size_t>(p)];
          besides[e][p] += (double{changes[c].more[e][i]} - double{changes[c].less[e][i]}) /
                           (changes[c].apart * seen.mean[p]);
        }
      }
      besides = polynomials.smoothed(besides);
      for (size_t e = 0; e < count; ++e) {
        for (Eigen::Index p = 0; p < seen.mean.size(); ++p) {
          relative[c][e][static_cast<Eigen::Index>(seen.pixels[static_cast<size_t>(p)])] =
              besides[e][p] + by_motion[p];
        }
      }
    }
  }
  return relative;
}

}  // namespace

std::vector<std::vector<float>> disturbances_of(std::span<const RenderedChange> changes,
                                                const std::vector<float>& mask, int width,
                                                std::span<const std::vector<float>> surface) {
  const std::vector<std::vector<Plane>> relative = relative_changes(changes, mask, width, surface);
  const size_t count = relative.front().size();
  const auto k = static_cast<double>(count);
  const Eigen::Index size = relative.front().front().size();
  // Products of different estimates, which are without bias.
  const auto n = static_cast<Eigen::Index>(changes.size());
  const auto on_object = static_cast<double>(std::ranges::count_if(mask, is_on_object)) *
                         static_cast<double>(size) / static_cast<double>(mask.size());
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(n, n);
  std::vector<Plane> means;
  for (const std::vector<Plane>& planes : relative) {
    Plane& sum = means.emplace_back(Plane::Zero(size));
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
  constexpr double kLeast = 0.001;
  constexpr Eigen::Index kMost = 5;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> turned(products);
  std::vector<std::vector<float>> planes;
  for (Eigen::Index i = n - 1; i >= std::max<Eigen::Index>(0, n - kMost); --i) {
    if (turned.eigenvalues()[i] < kLeast * kLeast) break;
    Plane sum = Plane::Zero(size);
    for (size_t e = 0; e < changes.size(); ++e) {
      sum += turned.eigenvectors()(static_cast<Eigen::Index>(e), i) * means[e];
    }
    const Eigen::VectorXf plane = sum.cast<float>();
    planes.emplace_back(plane.data(), plane.data() + plane.size());
  }
  return planes;
}

}  // namespace itn
