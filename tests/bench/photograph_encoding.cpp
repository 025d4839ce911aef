#include "tests/bench/photograph_encoding.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include "common/error.h"
#include "common/files/read_file.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

// OpenImageIO goes by it.
const char* file_name(Encoding encoding) {
  switch (encoding) {
    case Encoding::kPng: return "photograph.png";
    case Encoding::kJpeg: return "photograph.jpg";
    case Encoding::kTiff: return "photograph.tif";
    case Encoding::kHdr: return "photograph.hdr";
    case Encoding::kWebp: return "photograph.webp";
    case Encoding::kHeic: return "photograph.heic";
  }
  throw Error(ErrorKind::kInternal, "no such encoding");
}

}  // namespace

std::string encoded(int width, int height, std::span<const unsigned char> rgb, Encoding encoding) {
  const testing::TemporaryFolder folder;
  const std::string path = folder.path(file_name(encoding));
  const auto output = OIIO::ImageOutput::create(path);
  OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::UINT8);
  if (encoding == Encoding::kJpeg) spec["Compression"] = "jpeg:80";
  if (output == nullptr || !output->open(path, spec) ||
      !output->write_image(OIIO::TypeDesc::UINT8, rgb.data()) || !output->close()) {
    throw Error(ErrorKind::kInternal, fmt::format("cannot encode {}", path));
  }
  return read_file(path, "photograph");
}

}  // namespace itn
