#include "client/training/packed_inputs.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "common/error.h"

namespace itn {

PackedInputs::PackedInputs(const LabelledImages& images, const PackedFormat& format,
                           const std::filesystem::path& folder, std::stop_token stop)
    : packed_(format, images.items.size(), folder) {
  pack(images, stop);
}

void PackedInputs::pack(const LabelledImages& images, const std::stop_token& stop) {
  const size_t count = images.items.size();
  std::vector<ObjectSums> sums(count);
  std::atomic<size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr failure;
  const auto pack_some = [&] {
    for (size_t i = next++; i < count; i = next++) {
      if (stop.stop_requested()) {
        throw Error(ErrorKind::kCancelled, "interrupted");
      }
      const DatasetImage image = images.read(i);
      sums[i] = object_sums(image);
      packed_.put(i, images.resolution, image);
    }
  };
  {
    std::vector<std::jthread> threads;
    for (unsigned t = 0; t < std::max(1U, std::thread::hardware_concurrency()); ++t) {
      threads.emplace_back([&] {
        try {
          pack_some();
        } catch (...) {
          const std::lock_guard lock(mutex);
          failure = std::current_exception();
          next = count;
        }
      });
    }
  }
  if (failure) {
    std::rethrow_exception(failure);
  }
  // In the order of the images, so that the last bits are always the same.
  mean_radiance_ = itn::mean_radiance(sums);
}

}  // namespace itn
