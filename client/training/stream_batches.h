// Batches of a stream of renders (Stream in learning.proto).
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <stop_token>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "client/training/batches.h"
#include "client/training/image_source.h"
#include "client/training/packed_images.h"
#include "client/training/render_stream.h"

namespace itn {

inline constexpr uint32_t kStreamCapacity = 8192, kStreamFirst = 1024;  // defaults
inline constexpr double kStreamReuse = 8;

// Puts the default wherever a field is absent, and the full path of panoramas. Throws Error
// (invalid input) that names what is out of range.
void complete(v1::Stream& stream, uint32_t batch);

class StreamBatches final : public Batches {
 public:
  // For a training that goes on after `step` steps with batches of `batch` images. `stream` is
  // complete(); the pool must outlive it. `folder`: where the images are kept. Waits for the images
  // that the step needs, which after a pause are those that were held, rendered again. Throws
  // Error: kCancelled soon after a stop, kIo, and whatever becomes of a render.
  StreamBatches(const v1::Stream& stream, const PackedFormat& format, uint64_t step, uint32_t batch,
                uint64_t seed, RenderPool& pool, const std::filesystem::path& folder,
                std::stop_token stop);

  TrainingImages of_step(uint64_t step, uint32_t size) override;
  int resolution() const override { return images_.format().resolution; }
  uint64_t images_until(uint64_t step) const override;
  double waited_seconds() const override { return waited_seconds_; }

  // The images that are held.
  ImageSource held() const;
  // Of them.
  std::vector<Material> truth() const;
  double mean_radiance() const;

 private:
  void take_until(uint64_t count);
  // What the images that are held have in their places, the oldest first.
  template <typename T>
  std::vector<T> held(const std::vector<T>& by_place) const;

  v1::Stream stream_;
  uint32_t batch_;
  uint64_t seed_;
  std::stop_token stop_;
  PackedImages images_;           // image number n in place n % capacity
  std::vector<Material> truth_;   // by place
  std::vector<ObjectSums> sums_;  // by place
  uint64_t end_;                  // images of the stream that came; the newest of them are held
  double waited_seconds_ = 0;
  RenderStream renders_;
};

}  // namespace itn
