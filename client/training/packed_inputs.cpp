#include "client/training/packed_inputs.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "common/error.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

Error cannot(const char* what, const fs::path& folder, int error_number) {
  return Error(ErrorKind::kIo,
               fmt::format("cannot {} the inputs of the network in {}: {}", what, folder.string(),
                           std::error_code(error_number, std::generic_category()).message()));
}

// A file that no name leads to.
int open_unnamed(const fs::path& folder) {
  int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor < 0) {  // not every file system has such files
    std::string name = (folder / "inputs-XXXXXX").string();
    descriptor = ::mkostemp(name.data(), O_CLOEXEC);
    if (descriptor >= 0) {
      ::unlink(name.c_str());
    }
  }
  if (descriptor < 0) {
    throw cannot("write", folder, errno);
  }
  return descriptor;
}

size_t plane_bytes(const PackedFormat& format) {
  const auto side = static_cast<size_t>(format.resolution);
  return side * side * sizeof(float);
}

// The planes of an image in the order in which the file has them.
std::vector<torch::Tensor> planes_of(const ImageBatch& images) {
  std::vector<torch::Tensor> planes{images.luminance, images.mask};
  if (images.weight.defined()) {
    planes.push_back(images.weight);
  }
  return planes;
}

// One image of the file.
off_t offset_of(size_t index, size_t bytes) {
  return static_cast<off_t>(index * bytes);
}

// All or nothing: 0 or the errno of what failed.
template <typename Call>
int transfer(Call call, char* data, size_t size, off_t offset) {
  while (size > 0) {
    const ssize_t done = call(data, size, offset);
    if (done < 0 && errno == EINTR) {
      continue;
    }
    if (done <= 0) {
      return done < 0 ? errno : EIO;
    }
    data += done;
    size -= static_cast<size_t>(done);
    offset += done;
  }
  return 0;
}

}  // namespace

PackedInputs::PackedInputs(const LabelledImages& images, const PackedFormat& format,
                           const fs::path& folder, std::stop_token stop)
    : format_(format), descriptor_(open_unnamed(folder)), noise_(images.items.size()) {
  const size_t size = images.items.size() * static_cast<size_t>(planes()) * plane_bytes(format_);
  try {
    if (format_.resolution > images.resolution) {
      throw invalid_input(fmt::format(
          "the network is for {0} x {0} pixels; the images have {1} x {1}, which are fewer",
          format_.resolution, images.resolution));
    }
    // Room is missed now rather than after half of the images.
    if (const int error = ::posix_fallocate(descriptor_, 0, static_cast<off_t>(size))) {
      throw cannot(fmt::format("write {} MB of", size >> 20).c_str(), folder, error);
    }
    pack(images, stop);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

PackedInputs::~PackedInputs() {
  ::close(descriptor_);
}

void PackedInputs::pack(const LabelledImages& images, std::stop_token stop) {
  const size_t count = images.items.size();
  std::vector<double> radiance(count), area(count);  // sums over each image's object
  std::atomic<size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr failure;
  const auto pack_some = [&] {
    for (size_t i = next++; i < count; i = next++) {
      if (stop.stop_requested()) {
        throw Error(ErrorKind::kCancelled, "interrupted");
      }
      const DatasetImage image = images.read(i);
      for (size_t p = 0; p < image.mask.size(); ++p) {
        radiance[i] += static_cast<double>(image.mask[p]) * image.radiance[p];
        area[i] += image.mask[p];
      }
      // A mean over pixels is quieter than each of them.
      noise_[i] = static_cast<float>(image.relative_noise * format_.resolution / images.resolution);
      const torch::Tensor planes = torch::cat(planes_of(resampled(
          images.resolution, image.radiance, image.mask, format_.resolution, format_.input)));
      const int error = transfer(
          [&](char* data, size_t size, off_t at) { return ::pwrite(descriptor_, data, size, at); },
          static_cast<char*>(planes.data_ptr()), planes.nbytes(), offset_of(i, planes.nbytes()));
      if (error != 0) {
        throw cannot("write", "a temporary file", error);
      }
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
  double radiance_sum = 0, area_sum = 0;
  for (size_t i = 0; i < count; ++i) {
    radiance_sum += radiance[i];
    area_sum += area[i];
  }
  mean_radiance_ = area_sum > 0 ? radiance_sum / area_sum : 0;
}

int PackedInputs::planes() const {
  return needs_weight_map(format_.input) ? 3 : 2;
}

ImageBatch PackedInputs::batch(std::span<const uint32_t> items) const {
  const auto count = static_cast<int64_t>(items.size());
  const torch::Tensor planes =
      torch::empty({count, this->planes(), format_.resolution, format_.resolution});
  const size_t bytes = planes.nbytes() / items.size();
  auto* data = static_cast<char*>(planes.data_ptr());
  for (const uint32_t item : items) {
    const int error = transfer(
        [&](char* to, size_t size, off_t at) { return ::pread(descriptor_, to, size, at); }, data,
        bytes, offset_of(item, bytes));
    if (error != 0) {
      throw cannot("read", "a temporary file", error);
    }
    data += bytes;
  }
  ImageBatch images{.luminance = planes.select(1, 0),
                    .mask = planes.select(1, 1),
                    .weight = this->planes() == 3 ? planes.select(1, 2) : torch::Tensor(),
                    .noise = torch::empty({count})};
  auto noise = images.noise.accessor<float, 1>();
  for (size_t i = 0; i < items.size(); ++i) {
    noise[static_cast<int64_t>(i)] = noise_[items[i]];
  }
  return images;
}

}  // namespace itn
