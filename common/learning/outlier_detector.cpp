#include "common/learning/outlier_detector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>

#include "common/error.h"
#include "common/learning/encoder.h"
#include "common/learning/tensor_data.h"

namespace itn {
namespace {

// --- Statistics ---

constexpr float kOnObject = 0.5F;
// Smaller than anything that a photograph shows: black has statistics too.
constexpr double kMinLuminance = 1e-6, kMinRatio = 0.02, kMinContrast = 0.003;
constexpr double kMinPart = 0.01;
constexpr size_t kFewestContrasts = 16;
constexpr std::array kQuantiles{0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98};
// So near to the brightest pixel is as bright.
constexpr float kClipped = 0.995F;

// What each statistic says, as the middle of a sentence.
constexpr std::array<const char*, kImageStatistics> kNames{
    "mean radiance of the object",
    "radiance of its darkest parts over the mean",
    "radiance of its dark parts over the mean",
    "radiance of its dark quarter over the mean",
    "median radiance over the mean",
    "radiance of its bright quarter over the mean",
    "radiance of its bright parts over the mean",
    "radiance of its brightest parts over the mean",
    "noise",
    "contrast from pixel to pixel",
    "contrast over two pixels",
    "contrast over four pixels",
    "part of the image that the object takes",
    "part of the object that is as bright as its brightest pixel",
};

double floored_log(double value, double least) {
  return std::log(std::max(value, least));
}

// One image: rows of `side` pixels.
class Statistics {
 public:
  Statistics(const float* luminance, const float* mask, int64_t side)
      : luminance_(luminance), mask_(mask), side_(side) {
    for (int64_t i = 0; i < side * side; ++i) {
      if (mask[i] > kOnObject) {
        values_.push_back(luminance[i]);
        sum_ += luminance[i];
      }
    }
    std::ranges::sort(values_);
  }

  double mean() const { return values_.empty() ? 0 : sum_ / static_cast<double>(values_.size()); }

  double quantile(double q) const {
    return values_.empty()
               ? 0
               : values_[static_cast<size_t>(q * static_cast<double>(values_.size() - 1))];
  }

  double area() const {
    return static_cast<double>(values_.size()) / static_cast<double>(side_ * side_);
  }

  double clipped() const {
    if (values_.empty() || values_.back() <= 0) return 0;
    const auto first = std::ranges::lower_bound(values_, kClipped * values_.back());
    return static_cast<double>(values_.end() - first) / static_cast<double>(values_.size());
  }

  // |y - mean of the four pixels `distance` away| over the mean of all five, where all are on the
  // object.
  std::vector<double> contrasts(int64_t distance) const {
    std::vector<double> result;
    for (int64_t y = distance; y + distance < side_; ++y) {
      for (int64_t x = distance; x + distance < side_; ++x) {
        const int64_t pixel = y * side_ + x;
        const std::array<int64_t, 4> around{pixel - distance, pixel + distance,
                                            pixel - distance * side_, pixel + distance * side_};
        if (mask_[pixel] <= kOnObject ||
            std::ranges::any_of(around, [this](int64_t i) { return mask_[i] <= kOnObject; })) {
          continue;
        }
        double neighbours = 0;
        for (const int64_t i : around) neighbours += luminance_[i];
        const double mean = (neighbours + luminance_[pixel]) / 5;
        result.push_back(mean > 0 ? std::abs(luminance_[pixel] - neighbours / 4) / mean : 0);
      }
    }
    return result;
  }

 private:
  const float* luminance_;
  const float* mask_;
  int64_t side_;
  std::vector<float> values_;  // on the object, in rising order
  double sum_ = 0;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double root_mean_square(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return values.empty() ? 0 : std::sqrt(sum / static_cast<double>(values.size()));
}

void statistics_of(const v1::Model& model, const float* luminance, const float* mask, int64_t side,
                   double* out) {
  const Statistics s(luminance, mask, side);
  const double mean = s.mean();
  *out++ = model.exposure() == v1::EXPOSURE_UNKNOWN
               ? 0
               : floored_log(mean * model.image_scale(), kMinLuminance);
  for (const double q : kQuantiles) {
    *out++ = floored_log(mean > 0 ? s.quantile(q) / mean : 0, kMinRatio);
  }
  std::vector<double> contrasts = s.contrasts(1);
  *out++ = floored_log(median(contrasts), kMinContrast);
  *out++ = floored_log(root_mean_square(contrasts), kMinContrast);
  for (const int64_t distance : {2, 4}) {
    // A thin object may have hardly any: then it has what it has over a shorter distance.
    if (std::vector<double> farther = s.contrasts(distance); farther.size() >= kFewestContrasts) {
      contrasts = std::move(farther);
    }
    *out++ = floored_log(root_mean_square(contrasts), kMinContrast);
  }
  *out++ = floored_log(s.area(), kMinPart);
  *out++ = floored_log(s.clipped(), kMinPart);
}

// --- Gaussians ---

constexpr int64_t kMaxAxes = 64;
// The least part of the mean variance: a direction in which training images hardly vary counts as
// if they did a little, as held-out ones do.
constexpr double kMinVariance = 1e-2;
// Distances of statistics are logarithms: a difference of a fiftieth is none.
constexpr double kMinDeviation = 0.02;
constexpr double kUsual = 1 - 0.01 / 5;  // of each of five
constexpr int kQuantileSteps = 200;

double quantile_of(const torch::Tensor& values, double q) {
  return torch::quantile(values, q).item<double>();
}

v1::PrincipalGaussian fit(const torch::Tensor& vectors, double least_variance) {
  const torch::Tensor x = vectors.to(torch::kFloat64);
  const torch::Tensor mean = x.mean(0);
  const torch::Tensor d = x - mean;
  const torch::Tensor covariance = d.t().matmul(d) / static_cast<double>(x.size(0) - 1);
  const auto [variances, directions] = torch::linalg_eigh(covariance, "L");  // rising
  const int64_t size = x.size(1), kept = std::min(size, kMaxAxes);
  const double least = std::max(least_variance, kMinVariance * variances.mean().item<double>());
  const torch::Tensor largest = variances.slice(0, size - kept).clamp_min(least);
  const torch::Tensor axes = directions.slice(1, size - kept).t() / largest.sqrt().unsqueeze(1);
  v1::PrincipalGaussian gaussian;
  *gaussian.mutable_mean() = to_proto("mean", mean);
  *gaussian.mutable_axes() = to_proto("axes", axes);
  gaussian.set_rest(std::sqrt(
      size > kept ? std::max(least, variances.slice(0, 0, size - kept).mean().item<double>())
                  : least));
  gaussian.set_threshold(1);
  return gaussian;
}

void set_numbers(const torch::Tensor& values, google::protobuf::RepeatedField<double>* field) {
  const torch::Tensor v = values.contiguous();
  field->Assign(v.data_ptr<double>(), v.data_ptr<double>() + v.numel());
}

v1::StatisticsRange range_of(const torch::Tensor& statistics) {
  v1::StatisticsRange range;
  set_numbers(statistics.amin(0), range.mutable_lowest());
  set_numbers(torch::quantile(statistics, 0.5, 0), range.mutable_middle());
  set_numbers(statistics.amax(0), range.mutable_highest());
  range.set_threshold(1);
  return range;
}

// What tells `others` from `ours` best, in the metric of the covariance that both have about their
// means (Fisher, "The use of multiple measurements in taxonomic problems", 1936).
torch::Tensor discriminant(const torch::Tensor& ours, const torch::Tensor& others) {
  const auto scatter = [](const torch::Tensor& x) {
    const torch::Tensor d = x - x.mean(0);
    return d.t().matmul(d);
  };
  torch::Tensor covariance =
      (scatter(ours) + scatter(others)) / static_cast<double>(ours.size(0) + others.size(0));
  covariance.diagonal().add_(std::max(kMinVariance * covariance.diagonal().mean().item<double>(),
                                      kMinDeviation * kMinDeviation));
  const torch::Tensor difference = others.mean(0) - ours.mean(0);
  return at::linalg_solve(covariance, difference.unsqueeze(1)).squeeze(1);
}

// One for each of the statistics.
torch::Tensor read_statistics(const char* what,
                              const google::protobuf::RepeatedField<double>& field) {
  const std::vector<double> values(field.begin(), field.end());
  if (values.size() != static_cast<size_t>(kImageStatistics) ||
      !std::ranges::all_of(values, [](double x) { return std::isfinite(x); })) {
    throw invalid_input(
        fmt::format("model.outlier_model.{} must have {} finite numbers", what, kImageStatistics));
  }
  return torch::tensor(values, torch::kFloat64);
}

torch::Tensor read_tensor(const v1::Tensor& tensor) {
  std::vector<int64_t> shape(tensor.shape().begin(), tensor.shape().end());
  torch::Tensor values = torch::empty(shape);
  copy_values(tensor, values);
  return values.to(torch::kFloat64);
}

}  // namespace

torch::Tensor image_statistics(const v1::Model& model, const ImageBatch& in_any_colour) {
  const ImageBatch images = luminance_of(in_any_colour);
  const torch::Tensor luminance = images.luminance.contiguous(), mask = images.mask.contiguous();
  const int64_t side = luminance.size(-1);
  torch::Tensor statistics = torch::empty({images.size(), kImageStatistics}, torch::kFloat64);
  for (int64_t i = 0; i < images.size(); ++i) {
    statistics_of(model, luminance[i].data_ptr<float>(), mask[i].data_ptr<float>(), side,
                  statistics[i].data_ptr<double>());
  }
  return statistics;
}

ImageBatch tone_mapped(const ImageBatch& images) {
  constexpr double kGamma = 2.2, kDark = 1e-12;
  const torch::NoGradGuard no_gradient;
  const torch::Tensor object = (images.mask > kOnObject).to(torch::kFloat32);
  const torch::Tensor y = images.luminance * object;
  const torch::Tensor brightest = y.amax({1, 2}, true).clamp_min(kDark);
  const torch::Tensor encoded = brightest * (y / brightest).pow(1 / kGamma);
  const torch::Tensor same_mean = y.sum({1, 2}, true) / encoded.sum({1, 2}, true).clamp_min(kDark);
  const torch::Tensor odd =
      (for_planes(torch::arange(images.size()), images.channels) % 2 == 1).view({-1, 1, 1});
  ImageBatch result = images;
  result.luminance = encoded * torch::where(odd, same_mean, torch::ones_like(same_mean));
  if (result.noise.defined()) result.noise = result.noise / kGamma;
  return result;
}

ImageBatch shuffled(const ImageBatch& images) {
  constexpr uint64_t kSeed = 1;
  const torch::NoGradGuard no_gradient;
  at::Generator generator = at::detail::createCPUGenerator(kSeed);
  ImageBatch result = images;
  result.luminance = images.luminance.clone();
  if (images.noise.defined()) result.noise = images.noise.clone();
  for (int64_t i = 0; i < images.planes(); ++i) {
    const torch::Tensor object = (images.mask[i].flatten() > kOnObject).nonzero().squeeze(1);
    const torch::Tensor from = object.index_select(0, torch::randperm(object.size(0), generator));
    const auto move = [&](const torch::Tensor& whole, torch::Tensor& moved) {
      moved[i].view(-1).index_copy_(0, object, whole[i].flatten().index_select(0, from));
    };
    move(images.luminance, result.luminance);
    if (images.noise.defined()) move(images.noise, result.noise);
  }
  return result;
}

v1::OutlierModel fit_outlier_model(const Features& training, const CorruptedStatistics& corrupted,
                                   const Features& held_out) {
  const torch::NoGradGuard no_gradient;
  v1::OutlierModel outlier_model;
  *outlier_model.mutable_embedding() = fit(training.embedding, 0);
  *outlier_model.mutable_statistics() = fit(training.statistics, kMinDeviation * kMinDeviation);
  *outlier_model.mutable_range() = range_of(training.statistics);
  const torch::Tensor encoding = discriminant(training.statistics, corrupted.encoded);
  const torch::Tensor disorder = discriminant(training.statistics, corrupted.shuffled);
  set_numbers(encoding, outlier_model.mutable_encoding());
  set_numbers(disorder, outlier_model.mutable_disorder());
  outlier_model.add_quantiles(0);
  outlier_model.add_quantiles(1);
  const auto distances = [&] {
    return OutlierDetector(outlier_model, training.embedding.size(1)).distances(held_out);
  };
  // Thresholds.
  const OutlierDetector::Distances raw = distances();
  const auto usual = [](const torch::Tensor& of) {
    constexpr double kNone = 1e-6;
    return std::max(quantile_of(of, kUsual), kNone);
  };
  outlier_model.mutable_embedding()->set_threshold(usual(raw.embedding));
  outlier_model.mutable_statistics()->set_threshold(usual(raw.statistics));
  outlier_model.mutable_range()->set_threshold(usual(raw.range));
  set_numbers(encoding / usual(raw.encoding), outlier_model.mutable_encoding());
  set_numbers(disorder / usual(raw.disorder), outlier_model.mutable_disorder());
  // The scores that follow.
  const torch::Tensor scores = distances().largest();
  outlier_model.clear_quantiles();
  for (int i = 0; i <= kQuantileSteps; ++i) {
    outlier_model.add_quantiles(quantile_of(scores, static_cast<double>(i) / kQuantileSteps));
  }
  return outlier_model;
}

OutlierDetector::OutlierDetector(const v1::OutlierModel& outlier_model, int64_t embedding_size)
    : embedding_(read("embedding", outlier_model.embedding(), embedding_size)),
      statistics_(read("statistics", outlier_model.statistics(), kImageStatistics)),
      range_(read(outlier_model.range())),
      quantiles_(outlier_model.quantiles().begin(), outlier_model.quantiles().end()) {
  if (quantiles_.size() < 2 || !std::ranges::is_sorted(quantiles_) ||
      !std::ranges::all_of(quantiles_, [](double q) { return std::isfinite(q) && q >= 0; })) {
    throw invalid_input("model.outlier_model.quantiles must be rising and finite");
  }
  encoding_ = read_statistics("encoding", outlier_model.encoding());
  disorder_ = read_statistics("disorder", outlier_model.disorder());
  // The variances of the covariance sum of variance * direction direction^T, axis = direction /
  // deviation.
  const torch::Tensor variances = 1 / statistics_.axes.square().sum(1, true);
  deviations_ = (statistics_.axes.square() * variances.square()).sum(0).sqrt();
}

OutlierDetector::Gaussian OutlierDetector::read(const char* what,
                                                const v1::PrincipalGaussian& proto, int64_t size) {
  const int64_t axes = std::min(size, kMaxAxes);
  try {
    google::protobuf::RepeatedPtrField<v1::Tensor> tensors;
    *tensors.Add() = proto.mean();
    *tensors.Add() = proto.axes();
    validate(tensors, {{"mean", {size}}, {"axes", {axes, size}}});
  } catch (const Error& error) {
    throw invalid_input(fmt::format("model.outlier_model.{}: {}", what, error.what()));
  }
  const auto positive = [](double x) { return x > 0 && std::isfinite(x); };
  if (!positive(proto.rest()) || !positive(proto.threshold())) {
    throw invalid_input(
        fmt::format("model.outlier_model.{}: rest and threshold must be positive", what));
  }
  return {read_tensor(proto.mean()), read_tensor(proto.axes()), proto.rest(), proto.threshold()};
}

OutlierDetector::Range OutlierDetector::read(const v1::StatisticsRange& proto) {
  if (!(proto.threshold() > 0) || !std::isfinite(proto.threshold())) {
    throw invalid_input("model.outlier_model.range.threshold must be positive");
  }
  return {read_statistics("range.lowest", proto.lowest()),
          read_statistics("range.middle", proto.middle()),
          read_statistics("range.highest", proto.highest()), proto.threshold()};
}

torch::Tensor OutlierDetector::Range::distance(const torch::Tensor& statistics) const {
  const torch::Tensor above = (statistics - middle) / (highest - middle).clamp_min(kMinDeviation);
  const torch::Tensor below = (middle - statistics) / (middle - lowest).clamp_min(kMinDeviation);
  return torch::maximum(above, below).amax(1) / usual;
}

torch::Tensor OutlierDetector::Gaussian::distance(const torch::Tensor& vectors) const {
  const torch::Tensor d = vectors.to(torch::kFloat64) - mean;
  const torch::Tensor along = d.matmul(axes.t());  // in standard deviations
  // What of it lies along the axes, as a length.
  const torch::Tensor lengths = along / axes.square().sum(1).sqrt();
  const torch::Tensor beside =
      (d.square().sum(1) - lengths.square().sum(1)).clamp_min(0) / (rest * rest);
  return (along.square().sum(1) + beside).sqrt() / usual;
}

OutlierDetector::Distances OutlierDetector::distances(const Features& images) const {
  return {embedding_.distance(images.embedding), statistics_.distance(images.statistics),
          range_.distance(images.statistics), along(encoding_, images), along(disorder_, images)};
}

torch::Tensor OutlierDetector::along(const torch::Tensor& direction, const Features& images) const {
  return (images.statistics - statistics_.mean).matmul(direction).clamp_min(0);
}

std::vector<OutlierScore> OutlierDetector::scores(const Features& images) const {
  const Distances distances = this->distances(images);
  const torch::Tensor scores = distances.largest();
  std::vector<OutlierScore> result;
  for (int64_t i = 0; i < scores.size(0); ++i) {
    OutlierScore& u = result.emplace_back();
    u.score = scores[i].item<double>();
    u.rank =
        static_cast<double>(std::ranges::upper_bound(quantiles_, u.score) - quantiles_.begin()) /
        static_cast<double>(quantiles_.size());
    u.is_outlier = u.score > 1;
    if (u.is_outlier) {
      const auto at = [i](const torch::Tensor& distance) { return distance[i].item<double>(); };
      // What tells encoded images from proper ones means nothing of images that are neither.
      const bool encoded =
          at(distances.encoding) > 1 && at(distances.statistics) <= 1 && at(distances.range) <= 1;
      u.reason = at(distances.disorder) == u.score ? "it has no more order than noise"
                 : encoded ? "it looks as if encoded for a screen; radiance must be linear"
                           : unusual(images.statistics[i]);
    }
  }
  return result;
}

// The statistic that is farthest from its mean.
std::string OutlierDetector::unusual(const torch::Tensor& statistics) const {
  constexpr double kRemarkable = 3;
  const torch::Tensor z = (statistics - statistics_.mean) / deviations_;
  const auto most = z.abs().argmax().item<int64_t>();
  const double deviation = z[most].item<double>();
  if (std::abs(deviation) < kRemarkable) return "it looks like none of them";
  const double factor = std::exp((statistics[most] - statistics_.mean[most]).item<double>());
  return fmt::format("{}: {:.2g} times what is usual", kNames[static_cast<size_t>(most)], factor);
}

}  // namespace itn
