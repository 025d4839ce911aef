#include "client/training/shape_bootstrap.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "common/random.h"

namespace itn {
namespace {

constexpr size_t kDraws = 1000;
constexpr double kLow = 0.025, kHigh = 0.975;

double quantile(std::vector<double>& sorted, double probability) {
  return sorted[static_cast<size_t>(
      std::lround(probability * static_cast<double>(sorted.size() - 1)))];
}

}  // namespace

ShapeBootstrap::ShapeBootstrap(std::span<const std::string> shapes) {
  std::map<std::string, size_t> numbers;
  for (const std::string& shape : shapes) {
    const size_t number = numbers.try_emplace(shape, numbers.size()).first->second;
    group_.push_back(number);
    sizes_.resize(numbers.size());
    ++sizes_[number];
  }
  SplitMix random(1);
  draws_.resize(kDraws);
  for (std::vector<size_t>& draw : draws_) {
    for (size_t i = 0; i < sizes_.size(); ++i) draw.push_back(random.below(sizes_.size()));
  }
}

Estimate ShapeBootstrap::estimate(
    std::span<const std::vector<double>> terms,
    const std::function<double(std::span<const double>)>& statistic) const {
  // Sums over the images of each shape.
  std::vector<std::vector<double>> sums(terms.size(), std::vector<double>(sizes_.size()));
  for (size_t k = 0; k < terms.size(); ++k) {
    for (size_t i = 0; i < group_.size(); ++i) sums[k][group_[i]] += terms[k][i];
  }
  const auto apply = [&](std::span<const size_t> groups) {
    double images = 0;
    for (const size_t group : groups) images += sizes_[group];
    std::vector<double> means;
    for (const std::vector<double>& sum : sums) {
      double total = 0;
      for (const size_t group : groups) total += sum[group];
      means.push_back(total / images);
    }
    return statistic(means);
  };
  std::vector<size_t> all(sizes_.size());
  for (size_t i = 0; i < all.size(); ++i) all[i] = i;
  std::vector<double> values;
  for (const std::vector<size_t>& draw : draws_) values.push_back(apply(draw));
  std::ranges::sort(values);
  return {.value = apply(all), .low = quantile(values, kLow), .high = quantile(values, kHigh)};
}

Estimate ShapeBootstrap::root_mean_square(std::span<const double> errors) const {
  std::vector<double> squares;
  for (const double error : errors) squares.push_back(error * error);
  return estimate(std::span(&squares, 1),
                  [](std::span<const double> m) { return std::sqrt(m[0]); });
}

Estimate ShapeBootstrap::mean(std::span<const double> values) const {
  const std::vector<double> terms(values.begin(), values.end());
  return estimate(std::span(&terms, 1), [](std::span<const double> m) { return m[0]; });
}

}  // namespace itn
