#include "client/training/familiarity_fit.h"

#include <algorithm>
#include <vector>

#include "client/training/evaluation.h"
#include "common/error.h"
#include "common/learning/familiarity.h"
#include "common/learning/predictor.h"

namespace itn {
namespace {

constexpr size_t kMostImages = 1024, kFewestImages = 32;
constexpr size_t kImagesAtATime = 32;

ImageBatch as_they_are(const ImageBatch& images) {
  return images;
}

// Of the images, changed.
Features features_of(Predictor& predictor, const ImageSource& source,
                     std::span<const uint32_t> numbers, const std::stop_token& stop,
                     ImageBatch (*change)(const ImageBatch&) = as_they_are) {
  std::vector<torch::Tensor> embeddings, statistics;
  for (size_t first = 0; first < numbers.size(); first += kImagesAtATime) {
    if (stop.stop_requested()) {
      throw Error(ErrorKind::kCancelled, "interrupted");
    }
    const ImageBatch images =
        source.batch(numbers.subspan(first, std::min(kImagesAtATime, numbers.size() - first)));
    const Features features = predictor.features(change(images));
    embeddings.push_back(features.embedding);
    statistics.push_back(features.statistics);
  }
  return {torch::cat(embeddings), torch::cat(statistics)};
}

}  // namespace

std::optional<v1::Familiarity> measure_familiarity(const v1::Model& model,
                                                   const ImageSource& training,
                                                   const ImageSource& held_out,
                                                   const std::stop_token& stop) {
  if (training.count < kFewestImages) return std::nullopt;
  Predictor predictor(model);
  const std::vector<uint32_t> shown = spread(kMostImages, training.count);
  const auto encoded = [&](std::span<const uint32_t> numbers) {
    return features_of(predictor, training, numbers, stop, encoded_for_screen).statistics;
  };
  if (held_out.count >= kFewestImages) {
    return fit_familiarity(
        features_of(predictor, training, shown, stop), encoded(shown),
        features_of(predictor, held_out, spread(kMostImages, held_out.count), stop));
  }
  std::vector<uint32_t> rest, others;  // every fourth
  for (size_t i = 0; i < shown.size(); ++i) {
    (i % 4 == 3 ? others : rest).push_back(shown[i]);
  }
  return fit_familiarity(features_of(predictor, training, rest, stop), encoded(rest),
                         features_of(predictor, training, others, stop));
}

}  // namespace itn
