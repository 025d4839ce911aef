#include "tests/bench/photograph_encoding.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include "common/error.h"

namespace itn {

std::string encoded(int width, int height, std::span<const unsigned char> rgb, Encoding encoding) {
  const std::string name = encoding == Encoding::kJpeg ? "photograph.jpg" : "photograph.png";
  OIIO::Filesystem::IOVecOutput written;
  const auto output = OIIO::ImageOutput::create(name, &written);
  OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::UINT8);
  if (encoding == Encoding::kJpeg) spec["Compression"] = "jpeg:80";
  if (output == nullptr || !output->open(name, spec) ||
      !output->write_image(OIIO::TypeDesc::UINT8, rgb.data()) || !output->close()) {
    throw Error(ErrorKind::kInternal, "cannot encode " + name);
  }
  return {written.buffer().begin(), written.buffer().end()};
}

}  // namespace itn
