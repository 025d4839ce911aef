#include "client/refine/normal_equations.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <utility>

#include "common/error.h"
#include "common/learning/weight_map.h"

namespace itn {
namespace {

using Plane = std::vector<double>;  // by pixel that counts

void add(const Plane& terms, double factor, Plane& sum) {
  sum.resize(terms.size());
  for (size_t p = 0; p < terms.size(); ++p) sum[p] += factor * terms[p];
}

// The slope of y against x.
double slope(const Plane& x, const Plane& y) {
  double mean_x = 0, mean_y = 0, xx = 0, xy = 0;
  const auto count = static_cast<double>(x.size());
  for (size_t i = 0; i < x.size(); ++i) {
    mean_x += x[i] / count;
    mean_y += y[i] / count;
  }
  for (size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
  }
  return xx > 0 ? xy / xx : 0;
}

// The sum over the pixels of how planes of two coordinates vary together from estimate to estimate.
double scatter(const std::vector<std::vector<Plane>>& by_estimate, size_t c, size_t d,
               const Plane& weights) {
  double sum = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    double mean_c = 0, mean_d = 0, covariance = 0;
    for (const std::vector<Plane>& planes : by_estimate) {
      mean_c += planes[c][i] / static_cast<double>(by_estimate.size());
      mean_d += planes[d][i] / static_cast<double>(by_estimate.size());
    }
    for (const std::vector<Plane>& planes : by_estimate) {
      covariance += (planes[c][i] - mean_c) * (planes[d][i] - mean_d);
    }
    sum += weights[i] * covariance;
  }
  return sum;
}

Plane at_pixels(std::span<const float> image, std::span<const uint32_t> pixels) {
  Plane values;
  for (const uint32_t p : pixels) values.push_back(image[p]);
  return values;
}

}  // namespace

NormalEquations scaled(NormalEquations equations, double factor) {
  equations.curvature *= factor;
  equations.gradient *= factor;
  equations.render_noise *= factor * factor;
  return equations;
}

NormalEquations& NormalEquations::operator+=(const NormalEquations& terms) {
  curvature += terms.curvature;
  gradient += terms.gradient;
  render_noise += terms.render_noise;
  return *this;
}

void NormalEquations::add(const NormalEquations& terms,
                          const std::vector<Eigen::Index>& coordinates) {
  curvature(coordinates, coordinates) += terms.curvature;
  gradient(coordinates) += terms.gradient;
  render_noise(coordinates, coordinates) += terms.render_noise;
}

Structure& Structure::operator+=(const Structure& other) {
  of_quarters += other.of_quarters;
  of_blocks += other.of_blocks;
  shared += other.shared;
  of_image += other.of_image;
  blocks += other.blocks;
  return *this;
}

double Structure::relative() const {
  return std::sqrt(std::max(0.0, shared) / of_image);
}

bool Structure::is_misfit(double least) const {
  // Noise whose neighbours are alike over three pixels has 1.2. The ratio of independent ones has a
  // standard error of (3 / 2 blocks)^(1/2).
  constexpr double kAlike = 1.2, kStandardErrors = 3.5;
  return is_known() && over_noise() > kAlike + kStandardErrors * std::sqrt(1.5 / blocks) &&
         relative() > least;
}

ImageEquations::ImageEquations(const Observation& observation, v1::RefineSettings::Weights weights,
                               uint32_t block)
    : observation_(observation), weights_(weights), block_(block) {}

// ---- Pixels and their weights ----------------------------------------------------------------

void ImageEquations::choose_pixels(std::span<const float> coverage) {
  constexpr float kHalf = 0.5F;
  if (coverage.size() != observation_.radiance.size()) {
    throw invalid_input(observation_.name + ": the render has another size");
  }
  size_t given_count = 0, seen = 0;
  for (uint32_t p = 0; p < coverage.size(); ++p) {
    const bool given = observation_.mask.empty() || observation_.mask[p] > kHalf;
    given_count += given ? 1 : 0;
    seen += coverage[p] > kHalf ? 1 : 0;
    if (given && coverage[p] > kHalf) pixels_.push_back(p);
  }
  // A mask of the object hardly leaves it; one of all but the object hardly meets it.
  constexpr double kLeast = 0.5;
  if (!observation_.mask.empty() &&
      static_cast<double>(pixels_.size()) < kLeast * static_cast<double>(given_count)) {
    throw invalid_input(fmt::format(
        "{}: of the {} pixels of the mask, {} see the object of the scene, which is in {}: is the "
        "mask inverted, or do image and scene not belong together?",
        observation_.name, given_count, pixels_.size(), seen));
  }
  if (pixels_.empty()) {
    throw invalid_input(observation_.name +
                        ": the camera of its scene does not see the object; do image and "
                        "scene belong together?");
  }
  weigh_pixels();
}

void ImageEquations::weigh_pixels() {
  const uint32_t width = observation_.scene->width, height = observation_.scene->height;
  std::vector<int64_t> numbers_of_pixels(observation_.radiance.size(), -1);
  for (size_t i = 0; i < pixels_.size(); ++i)
    numbers_of_pixels[pixels_[i]] = static_cast<int64_t>(i);
  neighbours_.assign(pixels_.size(), {});
  for (size_t i = 0; i < pixels_.size(); ++i) {
    const uint32_t x = pixels_[i] % width, y = pixels_[i] / width;
    for (uint32_t v = y == 0 ? 0 : y - 1; v <= std::min(y + 1, height - 1); ++v) {
      for (uint32_t u = x == 0 ? 0 : x - 1; u <= std::min(x + 1, width - 1); ++u) {
        // A binomial filter: the nearer ones are listed as often as they count.
        const int64_t neighbour = numbers_of_pixels[size_t{v} * width + u];
        const size_t times = (u == x ? size_t{2} : 1) * (v == y ? 2 : 1);
        if (neighbour >= 0)
          neighbours_[i].insert(neighbours_[i].end(), times, static_cast<uint32_t>(neighbour));
      }
    }
  }
  blocks_.clear();
  places_.clear();
  std::map<std::pair<uint32_t, uint32_t>, Eigen::Index> numbers;
  for (const uint32_t p : pixels_) {
    const std::pair place{p / width / block_, p % width / block_};
    const auto [known, is_new] = numbers.emplace(place, std::ssize(numbers));
    if (is_new) places_.push_back(place);
    blocks_.push_back(known->second);
  }
  image_ = at_pixels(observation_.radiance, pixels_);
  disturbances_.clear();
  for (const std::vector<float>& plane : observation_.disturbances) {
    disturbances_.push_back(plane.empty() ? Plane() : at_pixels(plane, pixels_));
  }
  mean_ = 0;
  for (const double value : image_) mean_ += value / static_cast<double>(image_.size());
  if (!(mean_ > 0)) throw invalid_input(observation_.name + ": the image is black on the object");

  // Where nothing is known of the noise, it is that of light that is counted, 5 % at the mean.
  constexpr double kRelativeNoise = 0.05;
  const Plane smooth = smoothed(smoothed(image_));
  noise_exponent_ = 1;
  noise_at_mean_ = kRelativeNoise * kRelativeNoise * mean_ * mean_;
  squared_noise_.assign(pixels_.size(), 0);
  if (!observation_.noise.empty()) {
    Plane log_radiance, log_noise;
    double sum = 0, law = 0;
    for (size_t i = 0; i < pixels_.size(); ++i) {
      const double noise = observation_.noise[pixels_[i]];
      squared_noise_[i] = noise * noise;
      if (!(noise > 0) || !(smooth[i] > 0)) continue;
      log_radiance.push_back(std::log(smooth[i]));
      log_noise.push_back(2 * std::log(noise));
    }
    noise_exponent_ = std::clamp(slope(log_radiance, log_noise), 0.0, 3.0);
    for (size_t i = 0; i < pixels_.size(); ++i) {
      sum += squared_noise_[i];
      law += 1 / inverse_variance(smooth[i]);
    }
    if (sum > 0) noise_at_mean_ *= sum / law;
  }
  map_.clear();
  if (weights_ == v1::RefineSettings::MAP) {
    std::vector<float> mask(observation_.radiance.size());
    for (const uint32_t p : pixels_) mask[p] = 1;
    std::vector<float> luminance = observation_.radiance;
    for (float& value : luminance) value = std::max(value, 0.0F);
    const std::vector<float> map =
        weight_map(static_cast<int>(width), static_cast<int>(height), luminance, mask);
    map_ = at_pixels(map, pixels_);
    for (double& weight : map_) weight *= weight;
  }
  fixed_weights_.clear();
  for (size_t i = 0; i < pixels_.size(); ++i) {
    fixed_weights_.push_back(weights_ == v1::RefineSettings::NOISE ? inverse_variance(smooth[i])
                             : weights_ == v1::RefineSettings::MAP ? map_[i]
                                                                   : 1);
  }
}

// The variance of a pixel's noise follows its radiance as a power of it. A function of the radiance
// alone, so that a pixel does not count less for being too bright by chance.
double ImageEquations::inverse_variance(double radiance) const {
  constexpr double kDarkest = 0.02;  // of the mean
  const double relative = std::max(radiance / mean_, kDarkest);
  return 1 / (noise_at_mean_ * std::pow(relative, noise_exponent_));
}

std::vector<double> ImageEquations::smoothed(const std::vector<double>& values) const {
  Plane result;
  for (const std::vector<uint32_t>& neighbours : neighbours_) {
    double sum = 0;
    for (const uint32_t n : neighbours) sum += values[n];
    result.push_back(sum / static_cast<double>(neighbours.size()));
  }
  return result;
}

// ---- Looking ---------------------------------------------------------------------------------

double ImageEquations::exposure(const Render& render) {
  if (pixels_.empty()) choose_pixels(render.mask);
  double of_image = 0, of_render = 0;
  for (const RenderEstimate& estimate : render.estimates) {
    for (size_t i = 0; i < pixels_.size(); ++i) {
      of_image += image_[i];
      of_render += estimate.radiance[pixels_[i]];
    }
  }
  return of_render > 0 ? of_image / of_render : 1;
}

ImageEquations::Estimate ImageEquations::estimate_of(const RenderEstimate& render,
                                                     const Linearization& at,
                                                     const Plane& factors) const {
  Estimate estimate;
  const auto scaled = [&](size_t i, double value) { return at.exposure * factors[i] * value; };
  for (size_t i = 0; i < pixels_.size(); ++i) {
    estimate.radiance.push_back(scaled(i, render.radiance[pixels_[i]]));
  }
  for (Eigen::Index c = 0; c < at.jacobian.cols(); ++c) {
    Plane& derivative = estimate.derivatives.emplace_back();
    for (size_t i = 0; i < pixels_.size(); ++i) {
      double sum = 0;
      for (Eigen::Index r = 0; r < at.jacobian.rows(); ++r)
        sum += render.derivatives[static_cast<size_t>(r)][pixels_[i]] * at.jacobian(r, c);
      derivative.push_back(scaled(i, sum));
    }
  }
  if (at.exposure_is_coordinate) estimate.derivatives.push_back(estimate.radiance);
  for (size_t d = 0; d < at.disturbances.size(); ++d) {
    Plane& derivative = estimate.derivatives.emplace_back(pixels_.size());
    if (disturbances_[d].empty()) continue;
    for (size_t i = 0; i < pixels_.size(); ++i) {
      derivative[i] = estimate.radiance[i] * disturbances_[d][i] / factors[i];
    }
  }
  return estimate;
}

std::vector<std::vector<double>> ImageEquations::instruments_of(const Estimate& estimate,
                                                                const Residuals& residuals,
                                                                double others, bool plain) const {
  const size_t count = pixels_.size();
  const double past = plain ? 0 : samples_, now = residuals.samples;
  const auto without = [&](const Plane& own, const Plane& mean, const Plane& before) {
    Plane result(count);
    for (size_t i = 0; i < count; ++i) {
      // The mean of K estimates less a K-th of this one is `others` of them, as a part of all.
      const double here = now * (mean[i] - own[i] * (1 - others));
      result[i] = ((past > 0 ? before[i] : 0) + here) / (past + now * others);
    }
    return plain ? result : smoothed(smoothed(result));
  };
  std::vector<Plane> instruments;
  for (size_t c = 0; c < estimate.derivatives.size(); ++c) {
    instruments.push_back(without(estimate.derivatives[c], residuals.derivatives[c],
                                  derivatives_.empty() ? Plane() : derivatives_[c]));
  }
  Plane weights = fixed_weights_;
  if (weights_ == v1::RefineSettings::NOISE && !plain) {
    const Plane guide = without(estimate.radiance, residuals.radiance, radiance_);
    for (size_t i = 0; i < count; ++i) weights[i] = inverse_variance(guide[i]);
  }
  for (Plane& plane : instruments) {
    for (size_t i = 0; i < count; ++i) plane[i] *= weights[i];
  }
  return instruments;
}

ImageEquations::Residuals ImageEquations::evaluate(const Render& render, uint32_t spp,
                                                   const Linearization& linearization, bool plain) {
  if (pixels_.empty()) choose_pixels(render.mask);
  const size_t coordinates = linearization.coordinates(), count = pixels_.size();
  const Plane factors = disturbed(linearization.disturbances);
  std::vector<Estimate> estimates;
  for (const RenderEstimate& one : render.estimates) {
    estimates.push_back(estimate_of(one, linearization, factors));
  }
  const auto k_count = static_cast<double>(estimates.size());
  Residuals residuals;
  residuals.samples = spp;
  residuals.derivatives.resize(coordinates);
  for (const Estimate& estimate : estimates) {
    add(estimate.radiance, 1 / k_count, residuals.radiance);
    for (size_t c = 0; c < coordinates; ++c) {
      add(estimate.derivatives[c], 1 / k_count, residuals.derivatives[c]);
    }
  }

  // Multiply what is left of the image, and the derivatives, by instruments of the other estimates.
  residuals.scores.assign(coordinates, Plane(count));
  residuals.slopes.assign(coordinates * coordinates, Plane(count));
  std::vector<std::vector<Plane>> scores, instruments;  // by estimate, coordinate, pixel
  for (const Estimate& estimate : estimates) {
    const std::vector<Plane>& z_of_others = instruments.emplace_back(
        instruments_of(estimate, residuals, (k_count - 1) / k_count, plain));
    std::vector<Plane>& by_coordinate = scores.emplace_back(coordinates, Plane(count));
    for (size_t c = 0; c < coordinates; ++c) {
      for (size_t i = 0; i < count; ++i) {
        const double z = z_of_others[c][i];
        by_coordinate[c][i] = z * (image_[i] - estimate.radiance[i]);
        residuals.scores[c][i] += by_coordinate[c][i] / k_count;
        for (size_t d = 0; d < coordinates; ++d) {
          residuals.slopes[c * coordinates + d][i] += z * estimate.derivatives[d][i] / k_count;
        }
      }
    }
  }

  // Sum over the pixels.
  Plane differences;
  for (size_t i = 0; i < count; ++i) differences.push_back(image_[i] - residuals.radiance[i]);
  residuals.equations = NormalEquations(static_cast<Eigen::Index>(coordinates));
  for (size_t c = 0; c < coordinates; ++c) {
    for (const double score : residuals.scores[c]) residuals.equations.gradient[c] += score;
    for (size_t d = 0; d < coordinates; ++d) {
      for (const double slope : residuals.slopes[c * coordinates + d]) {
        residuals.equations.curvature(c, d) += slope;
      }
    }
  }

  // The noise of the renders in the scores. And the noise of the instruments meets what is left of
  // the image: with the variance v of one estimate of M / K samples, it has that of all n samples,
  // v M / (K n); instruments that leave out one estimate each, n' samples behind them, differ by
  // v (M / K n')^2.
  const double past = plain ? 0 : samples_, now = spp;
  const double n = past + now, without_one = past + now * (k_count - 1) / k_count;
  const double leverage = without_one * without_one / (n * (k_count - 1) * now / k_count);
  const Plane ones(count, 1);
  Plane squared_differences;
  for (const double difference : differences)
    squared_differences.push_back(difference * difference);
  for (size_t c = 0; c < coordinates; ++c) {
    for (size_t d = 0; d < coordinates; ++d) {
      residuals.equations.render_noise(c, d) =
          scatter(scores, c, d, ones) / (k_count * (k_count - 1)) +
          leverage * scatter(instruments, c, d, squared_differences);
    }
  }
  residuals.structure = structure_of(differences);

  // (I - T)^2 from different estimates: the squared mean less its own variance.
  for (size_t i = 0; i < count; ++i) {
    const double w = fixed_weights_[i];
    const double difference = differences[i];
    double variance = 0;
    for (const Estimate& estimate : estimates) {
      variance +=
          std::pow(estimate.radiance[i] - residuals.radiance[i], 2) / (k_count * (k_count - 1));
    }
    residuals.squares += w * (difference * difference - variance);
    residuals.squares_variance += w * w * variance * (4 * difference * difference + 2 * variance);
    residuals.energy += w * image_[i] * image_[i];
    residuals.noise += w * squared_noise_[i];
  }
  return residuals;
}

std::vector<double> ImageEquations::disturbed(std::span<const double> amounts) const {
  constexpr double kLeast = 0.1;  // linear is what it is for less
  Plane factors(pixels_.size(), 1);
  for (size_t d = 0; d < amounts.size(); ++d) {
    if (!disturbances_[d].empty()) add(disturbances_[d], amounts[d], factors);
  }
  for (double& factor : factors) factor = std::max(factor, kLeast);
  return factors;
}

Structure ImageEquations::structure_of(std::span<const double> differences) const {
  // The largest blocks of which there are many.
  constexpr size_t kMany = 64;
  uint32_t side = 4;
  while (side < 16 && pixels_.size() / (size_t{4} * side * side) >= kMany) side *= 2;
  struct Quarter {
    double difference = 0, pixels = 0;
  };
  struct Block {
    std::array<Quarter, 4> quarters{};
    double energy = 0;
  };
  const uint32_t width = observation_.scene->width;
  const Plane scaled_differences = in_deviations({differences.begin(), differences.end()});
  std::map<std::pair<uint32_t, uint32_t>, Block> blocks;
  for (size_t i = 0; i < pixels_.size(); ++i) {
    const uint32_t x = pixels_[i] % width, y = pixels_[i] / width;
    Block& block = blocks[{y / side, x / side}];
    Quarter& quarter = block.quarters[2 * (y % side / (side / 2)) + x % side / (side / 2)];
    quarter.difference += robust_weight(i) * scaled_differences[i];
    ++quarter.pixels;
    block.energy += fixed_weights_[i] * image_[i] * image_[i];
  }
  Structure structure;
  for (const auto& [place, block] : blocks) {
    // If n pixels share a difference, a block has n^2 of its square, and so has a quarter.
    const double n = block.quarters[0].pixels + block.quarters[1].pixels +
                     block.quarters[2].pixels + block.quarters[3].pixels;
    double pairs = n * n, sum = 0, of_quarters = 0;
    for (const Quarter& quarter : block.quarters) {
      pairs -= quarter.pixels * quarter.pixels;
      sum += quarter.difference;
      of_quarters += quarter.difference * quarter.difference;
    }
    // Little may be left of a block where the object ends, or of all its quarters but one.
    constexpr double kLeast = 0.25;
    if (n < kLeast * side * side || pairs < kLeast * n * n) continue;
    structure += {.of_quarters = of_quarters,
                  .of_blocks = sum * sum,
                  .shared = (sum * sum - of_quarters) * n / pairs,
                  .of_image = block.energy,
                  .blocks = 1};
  }
  return structure;
}

void ImageEquations::accumulate(const Residuals& residuals, const Vector& moved, double decay,
                                double long_decay) {
  const size_t coordinates = residuals.scores.size(), count = pixels_.size();
  if (samples_ == 0) {
    radiance_.assign(count, 0);
    derivatives_.assign(coordinates, Plane(count));
    scores_.assign(coordinates, Plane(count));
    slopes_.assign(coordinates * coordinates, Plane(count));
  } else {
    scores_ = scores_after(moved);
  }
  const auto mix = [&](Plane& sum, double part, const Plane& now) {
    for (size_t i = 0; i < count; ++i) sum[i] = part * sum[i] + residuals.samples * now[i];
  };
  samples_ = long_decay * samples_ + residuals.samples;
  mix(radiance_, long_decay, residuals.radiance);
  for (size_t c = 0; c < coordinates; ++c) {
    mix(derivatives_[c], long_decay, residuals.derivatives[c]);
    mix(scores_[c], decay, residuals.scores[c]);
  }
  for (size_t s = 0; s < slopes_.size(); ++s) mix(slopes_[s], decay, residuals.slopes[s]);
}

std::vector<std::vector<double>> ImageEquations::scores_after(const Vector& step) const {
  std::vector<Plane> scores = scores_;
  for (size_t c = 0; c < scores.size(); ++c) {
    for (size_t d = 0; d < scores.size(); ++d) {
      add(slopes_[c * scores.size() + d], -step[d], scores[c]);
    }
  }
  return scores;
}

std::vector<double> ImageEquations::differences_so_far() const {
  Plane differences;
  for (size_t i = 0; i < pixels_.size(); ++i) {
    differences.push_back(image_[i] - radiance_[i] / samples_);
  }
  return differences;
}

std::vector<double> ImageEquations::in_deviations(std::vector<double> differences) const {
  for (size_t i = 0; i < differences.size(); ++i) differences[i] *= std::sqrt(fixed_weights_[i]);
  return differences;
}

double ImageEquations::dependence() const {
  constexpr uint32_t kLarger = 4;
  constexpr size_t kEnough = 12;
  if (block_ == 1 || samples_ == 0) return 1;
  const Plane differences = in_deviations(differences_so_far());
  const auto sums_over = [&](uint32_t side) {
    const uint32_t width = observation_.scene->width;
    std::map<std::pair<uint32_t, uint32_t>, double> sums;
    for (size_t i = 0; i < pixels_.size(); ++i) {
      sums[{pixels_[i] / width / side, pixels_[i] % width / side}] +=
          robust_weight(i) * differences[i];
    }
    return sums;
  };
  const auto squared = [](const auto& sums) {
    double result = 0;
    for (const auto& [place, sum] : sums) result += sum * sum;
    return result;
  };
  const double of_squares = squared(sums_over(block_));
  for (uint32_t factor = kLarger; factor > 1; factor /= 2) {
    const auto larger = sums_over(factor * block_);
    if (larger.size() < kEnough) continue;
    return std::max(1.0, squared(larger) / of_squares);
  }
  return 1;
}

void ImageEquations::find_unexplained() {
  constexpr double kFar = 5;            // standard deviations of the others
  constexpr double kVisible = 0.05;     // of the radiance
  constexpr double kMost = 0.05;        // of the pixels
  constexpr double kOfMedian = 1.4826;  // the standard deviation of a Gaussian
  const Plane differences = differences_so_far();
  const Plane smooth = smoothed(in_deviations(differences));
  Plane render;
  for (const double sum : radiance_) render.push_back(sum / samples_);
  render = smoothed(render);
  Plane sizes;
  for (const double value : smooth) sizes.push_back(std::abs(value));
  const auto middle = sizes.begin() + std::ssize(sizes) / 2;
  std::ranges::nth_element(sizes, middle);
  const double far = kFar * kOfMedian * *middle;
  robust_weights_.assign(pixels_.size(), 1);
  size_t count = 0;
  for (size_t i = 0; i < pixels_.size(); ++i) {
    // By itself, too, as beside dust there may be none.
    const double alone = std::copysign(1, smooth[i]) * differences[i];
    if (std::abs(smooth[i]) <= far || alone <= kVisible * render[i]) continue;
    robust_weights_[i] = far * far / (smooth[i] * smooth[i]);
    ++count;
  }
  if (count == 0 || static_cast<double>(count) > kMost * static_cast<double>(pixels_.size())) {
    robust_weights_.clear();
  }
}

std::vector<uint32_t> ImageEquations::unexplained_pixels() const {
  std::vector<uint32_t> result;
  for (size_t i = 0; i < robust_weights_.size(); ++i) {
    if (robust_weights_[i] < 1) result.push_back(pixels_[i]);
  }
  return result;
}

NormalEquations ImageEquations::unexplained_terms() const {
  const size_t coordinates = scores_.size();
  NormalEquations terms(static_cast<Eigen::Index>(coordinates));
  for (size_t i = 0; i < robust_weights_.size(); ++i) {
    const double missing = 1 - robust_weights_[i];
    if (missing == 0) continue;
    for (size_t c = 0; c < coordinates; ++c) {
      terms.gradient[c] += missing * scores_[c][i];
      for (size_t d = 0; d < coordinates; ++d) {
        terms.curvature(c, d) += missing * slopes_[c * coordinates + d][i];
      }
    }
  }
  return terms;
}

Eigen::MatrixXd ImageEquations::square_terms() const {
  const auto coordinates = static_cast<Eigen::Index>(scores_.size());
  Eigen::MatrixXd terms =
      Eigen::MatrixXd::Zero(std::ssize(places_), coordinates * (1 + coordinates));
  Eigen::Index column = 0;
  for (const std::vector<Plane>* planes : {&scores_, &slopes_}) {
    for (const Plane& plane : *planes) {
      for (size_t i = 0; i < plane.size(); ++i) {
        terms(blocks_[i], column) += robust_weight(i) * plane[i];
      }
      ++column;
    }
  }
  return terms;
}

GrowthBySquare ImageEquations::growth(uint32_t side, Eigen::Index exposure) const {
  const auto coordinates = static_cast<Eigen::Index>(scores_.size());
  const uint32_t width = observation_.scene->width;
  GrowthBySquare squares;
  for (size_t i = 0; i < pixels_.size(); ++i) {
    const uint32_t x = pixels_[i] % width, y = pixels_[i] / width;
    SquareGrowth& square = squares[{y / side, x / side}];
    if (square.pixels == 0) square.scores = Vector::Zero(coordinates);
    for (Eigen::Index c = 0; c < coordinates; ++c) {
      square.scores[c] +=
          robust_weight(i) * slopes_[static_cast<size_t>(c * coordinates + exposure)][i];
    }
    square.x += x;
    square.y += y;
    ++square.pixels;
  }
  return squares;
}

Matrix model_error(const GrowthBySquare& squares, double size, double length) {
  constexpr double kFar = 4;  // lengths: beyond, nothing is alike
  Matrix sum;
  for (const auto& [place, a] : squares) {
    Vector alike = Vector::Zero(a.scores.size());
    for (const auto& [other_place, b] : squares) {
      const double x = a.x / a.pixels - b.x / b.pixels, y = a.y / a.pixels - b.y / b.pixels;
      const double squared = (x * x + y * y) / (length * length);
      if (squared < kFar * kFar) alike += std::exp(-squared / 2) * b.scores;
    }
    if (sum.size() == 0) sum = Matrix::Zero(alike.size(), alike.size());
    sum += a.scores * alike.transpose();
  }
  return size * size * sum;
}

// ---- State -----------------------------------------------------------------------------------

v1::RefineImageState ImageEquations::state() const {
  v1::RefineImageState state;
  state.mutable_pixels()->Add(pixels_.begin(), pixels_.end());
  state.set_samples(samples_);
  state.mutable_radiance()->Add(radiance_.begin(), radiance_.end());
  for (const Plane& plane : derivatives_) {
    state.mutable_derivatives()->Add(plane.begin(), plane.end());
  }
  for (const Plane& plane : scores_) state.mutable_scores()->Add(plane.begin(), plane.end());
  for (const Plane& plane : slopes_) state.mutable_slopes()->Add(plane.begin(), plane.end());
  return state;
}

void ImageEquations::restore(const v1::RefineImageState& state, size_t coordinates) {
  const auto count = state.pixels_size();
  const auto planes = static_cast<int>(coordinates) * count;
  const bool rising = std::ranges::adjacent_find(state.pixels(), std::ranges::greater_equal()) ==
                      state.pixels().end();
  const bool seen = state.radiance_size() > 0;
  if (!rising || (count > 0 && state.pixels(count - 1) >= observation_.radiance.size()) ||
      (seen && (state.radiance_size() != count || state.derivatives_size() != planes ||
                state.scores_size() != planes ||
                state.slopes_size() != planes * static_cast<int>(coordinates)))) {
    throw invalid_input("the state of the refinement is damaged");
  }
  pixels_.assign(state.pixels().begin(), state.pixels().end());
  if (pixels_.empty()) return;
  weigh_pixels();
  if (!seen) return;
  samples_ = state.samples();
  radiance_.assign(state.radiance().begin(), state.radiance().end());
  const auto planes_of = [count](const auto& values) {
    std::vector<Plane> result;
    for (int first = 0; first < values.size(); first += count) {
      result.emplace_back(values.begin() + first, values.begin() + first + count);
    }
    return result;
  };
  derivatives_ = planes_of(state.derivatives());
  scores_ = planes_of(state.scores());
  slopes_ = planes_of(state.slopes());
}

}  // namespace itn
