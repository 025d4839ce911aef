#include "client/training/outlier_fit.h"

#include <algorithm>
#include <vector>

#include "client/training/evaluation.h"
#include "common/error.h"
#include "common/learning/outlier_detector.h"
#include "common/learning/predictor.h"

namespace itn {
namespace {

constexpr size_t kMaxImages = 4096, kMaxSpoilt = 1024, kFewestImages = 32;
// An image shows little else than noise where samples ran out; if such images counted as what is
// usual, noise would.
constexpr double kMuchNoise = 1.5;  // over the median

ImageBatch unchanged(const ImageBatch& images) {
  return images;
}

struct Shown {
  Features features;
  torch::Tensor noise;  // images: relative

  // The images of which `which` is true.
  Shown part(const torch::Tensor& which) const {
    const torch::Tensor kept = which.nonzero().squeeze(1);
    return {{features.embedding.index_select(0, kept), features.statistics.index_select(0, kept)},
            noise.index_select(0, kept)};
  }

  Shown less_noisy_than(double limit) const { return part(noise <= limit); }
};

// The noise of each image, on average over the object; none where nobody knows it.
torch::Tensor mean_noise(const ImageBatch& in_any_colour) {
  const ImageBatch images = luminance_of(in_any_colour);
  if (!images.noise.defined()) return torch::zeros({images.size()});
  // Some pixel may show nothing else.
  return (images.noise.clamp_max(1) * images.mask).sum({1, 2}) /
         images.mask.sum({1, 2}).clamp_min(1);
}

// What the predictor says of the images, changed.
Shown show(Predictor& predictor, const ImageSource& source, std::span<const uint32_t> numbers,
           const std::stop_token& stop, ImageBatch (*change)(const ImageBatch&) = unchanged) {
  std::vector<torch::Tensor> embeddings, statistics, noises;
  for (size_t first = 0; first < numbers.size(); first += kImagesAtATime) {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    const ImageBatch images =
        source.batch(numbers.subspan(first, std::min(kImagesAtATime, numbers.size() - first)));
    const Features features = predictor.features(change(images));
    embeddings.push_back(features.embedding);
    statistics.push_back(features.statistics);
    noises.push_back(mean_noise(images));
  }
  return {{torch::cat(embeddings), torch::cat(statistics)}, torch::cat(noises)};
}

}  // namespace

std::optional<v1::OutlierModel> measure_outlier_model(const v1::Model& model,
                                                      const ImageSource& training,
                                                      const ImageSource& held_out,
                                                      const std::stop_token& stop) {
  if (training.count < kFewestImages) return std::nullopt;
  Predictor predictor(model);
  const Shown all = show(predictor, training, spread(kMaxImages, training.count), stop);
  const double limit = std::max(model.noise(), kMuchNoise * all.noise.median().item<double>());
  const Shown usual = all.less_noisy_than(limit);
  const auto statistics_after = [&](ImageBatch (*change)(const ImageBatch&)) {
    return show(predictor, training, spread(kMaxSpoilt, training.count), stop, change)
        .less_noisy_than(limit)
        .features.statistics;
  };
  const CorruptedStatistics corrupted{.encoded = statistics_after(tone_mapped),
                                      .shuffled = statistics_after(shuffled)};
  if (held_out.count >= kFewestImages) {
    const Shown others =
        show(predictor, held_out, spread(kMaxImages, held_out.count), stop).less_noisy_than(limit);
    if (others.noise.size(0) >= static_cast<int64_t>(kFewestImages)) {
      return fit_outlier_model(usual.features, corrupted, others.features);
    }
  }
  const torch::Tensor fourth = torch::arange(usual.noise.size(0)) % 4 == 3;
  return fit_outlier_model(usual.part(~fourth).features, corrupted, usual.part(fourth).features);
}

}  // namespace itn
