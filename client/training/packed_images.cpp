#include "client/training/packed_images.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

#include "client/training/noise_map.h"
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

PackedImages::PackedImages(const PackedFormat& format, size_t count, const fs::path& folder)
    : format_(format), size_(count), descriptor_(open_unnamed(folder)) {
  const size_t size = count * static_cast<size_t>(planes()) * plane_bytes(format_);
  // Room is missed now rather than after half of the images.
  if (const int error = ::posix_fallocate(descriptor_, 0, static_cast<off_t>(size))) {
    ::close(descriptor_);
    throw cannot(fmt::format("write {} MB of", size >> 20).c_str(), folder, error);
  }
}

PackedImages::~PackedImages() {
  ::close(descriptor_);
}

int PackedImages::planes() const {
  return needs_weight_map(format_.input) ? 4 : 3;
}

void PackedImages::put(size_t place, int resolution, const DatasetImage& image) {
  if (format_.resolution > resolution) {
    throw invalid_input(fmt::format(
        "the network is for {0} x {0} pixels; the images have {1} x {1}, which are fewer",
        format_.resolution, resolution));
  }
  ImageBatch packed =
      resampled(resolution, image.radiance, image.mask, format_.resolution, format_.input);
  packed.noise = noise_map(image, resolution, format_.resolution);
  const torch::Tensor planes = torch::cat(planes_of(packed));
  const int error = transfer(
      [&](char* data, size_t size, off_t at) { return ::pwrite(descriptor_, data, size, at); },
      static_cast<char*>(planes.data_ptr()), planes.nbytes(), offset_of(place, planes.nbytes()));
  if (error != 0) {
    throw cannot("write", "a temporary file", error);
  }
}

ImageBatch PackedImages::batch(std::span<const uint32_t> places) const {
  const auto count = static_cast<int64_t>(places.size());
  const torch::Tensor planes =
      torch::empty({count, this->planes(), format_.resolution, format_.resolution});
  const size_t bytes = planes.nbytes() / places.size();
  auto* data = static_cast<char*>(planes.data_ptr());
  for (const uint32_t place : places) {
    const int error = transfer(
        [&](char* to, size_t size, off_t at) { return ::pread(descriptor_, to, size, at); }, data,
        bytes, offset_of(place, bytes));
    if (error != 0) {
      throw cannot("read", "a temporary file", error);
    }
    data += bytes;
  }
  const bool weight = needs_weight_map(format_.input);
  return {.luminance = planes.select(1, 0),
          .mask = planes.select(1, 1),
          .weight = weight ? planes.select(1, 2) : torch::Tensor(),
          .noise = planes.select(1, weight ? 3 : 2)};
}

ObjectSums object_sums(const DatasetImage& image) {
  ObjectSums sums;
  for (size_t p = 0; p < image.mask.size(); ++p) {
    sums.radiance += static_cast<double>(image.mask[p]) * image.radiance[p];
    sums.area += image.mask[p];
  }
  return sums;
}

double mean_radiance(std::span<const ObjectSums> images) {
  ObjectSums all;
  for (const ObjectSums& image : images) {
    all.radiance += image.radiance;
    all.area += image.area;
  }
  return all.area > 0 ? all.radiance / all.area : 0;
}

}  // namespace itn
