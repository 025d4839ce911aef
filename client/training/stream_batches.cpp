#include "client/training/stream_batches.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "client/dataset/dataset_config.h"
#include "common/error.h"
#include "common/random.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

// Images that have come when the step after so many is taken.
uint64_t images_before(const v1::Stream& stream, uint64_t step, uint32_t batch) {
  return stream.first() +
         static_cast<uint64_t>(std::floor(static_cast<double>(step) * batch / stream.reuse()));
}

// The oldest of them that is held.
uint64_t oldest(const v1::Stream& stream, uint64_t count) {
  return count - std::min<uint64_t>(count, stream.capacity());
}

// The run may go on from somewhere else.
void make_absolute(v1::PanoramaChoice& panoramas) {
  if (panoramas.folder().empty()) return;  // an error when they are looked for
  panoramas.set_folder(std::filesystem::absolute(panoramas.folder()).lexically_normal().string());
}

}  // namespace

void complete(v1::Stream& stream, uint32_t batch) {
  if (stream.capacity() == 0) stream.set_capacity(kStreamCapacity);
  if (stream.first() == 0) stream.set_first(kStreamFirst);
  if (stream.reuse() == 0) stream.set_reuse(kStreamReuse);
  require(stream.capacity() >= batch, "stream.capacity must be as large as a batch at least");
  require(stream.first() >= batch, "stream.first must be as large as a batch at least");
  require(stream.reuse() >= 1 && stream.reuse() <= 1000, "stream.reuse must be in [1, 1000]");
  v1::DatasetConfig& images = *stream.mutable_images();
  set_defaults(images);
  require(images.materials().sampling() != v1::MaterialChoice::GRID,
          "a grid of materials ends; a stream does not");
  require(!images.derivatives(), "a stream holds no derivative images");
  if (!images.shapes().has_random()) {
    v1::RandomShapes& shapes = *images.mutable_shapes()->mutable_random();
    shapes.set_count(2);  // of no account, but checked
  }
  for (v1::LightChoice& light : *images.mutable_lights()) {
    if (light.has_panoramas()) make_absolute(*light.mutable_panoramas());
  }
  images.set_test_fraction(0);
  images.set_validation_fraction(0);
  validate(images);
}

StreamBatches::StreamBatches(const v1::Stream& stream, const PackedFormat& format, uint64_t step,
                             uint32_t batch, uint64_t seed, RenderPool& pool,
                             const std::filesystem::path& folder, std::stop_token stop)
    : stream_(stream),
      batch_(batch),
      seed_(seed),
      stop_(std::move(stop)),
      images_(format, stream.capacity(), folder),
      truth_(stream.capacity()),
      sums_(stream.capacity()),
      end_(oldest(stream, images_before(stream, step, batch))),
      renders_(stream.images(), pool, end_) {
  take_until(images_before(stream_, step, batch_));
}

uint64_t StreamBatches::images_until(uint64_t step) const {
  return images_before(stream_, step, batch_);
}

TrainingImages StreamBatches::of_step(uint64_t step, uint32_t size) {
  const uint64_t count = images_until(step);
  take_until(count);
  const uint64_t first = oldest(stream_, count);
  SplitMix random(derive_seed(seed_, {step}));
  TrainingImages result;
  std::vector<uint32_t> places;
  for (uint32_t i = 0; i < size; ++i) {
    places.push_back(
        static_cast<uint32_t>((first + random.below(count - first)) % stream_.capacity()));
    result.truth.push_back(truth_[places.back()]);
  }
  result.images = images_.batch(places);
  return result;
}

void StreamBatches::take_until(uint64_t count) {
  const auto start = std::chrono::steady_clock::now();
  for (; end_ < count; ++end_) {
    const StreamedImage next = renders_.next(stop_);
    const size_t place = end_ % stream_.capacity();
    images_.put(place, static_cast<int>(stream_.images().resolution()), next.image);
    truth_[place] = from_proto(next.item.material());
    sums_[place] = object_sums(next.image);
  }
  waited_seconds_ +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

ImageSource StreamBatches::held() const {
  return {
      .count = end_ - oldest(stream_, end_), .batch = [this](std::span<const uint32_t> numbers) {
        std::vector<uint32_t> places;
        for (const uint32_t n : numbers) {
          places.push_back(static_cast<uint32_t>((oldest(stream_, end_) + n) % stream_.capacity()));
        }
        return images_.batch(places);
      }};
}

template <typename T>
std::vector<T> StreamBatches::held(const std::vector<T>& by_place) const {
  std::vector<T> result;
  for (uint64_t n = oldest(stream_, end_); n < end_; ++n) {
    result.push_back(by_place[n % stream_.capacity()]);
  }
  return result;
}

std::vector<Material> StreamBatches::truth() const {
  return held(truth_);
}

double StreamBatches::mean_radiance() const {
  return itn::mean_radiance(held(sums_));
}

}  // namespace itn
