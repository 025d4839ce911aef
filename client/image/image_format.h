// What kind of file bytes are, by how they begin: names of files say nothing of it.
#pragma once

#include <string_view>

namespace itn {

enum class ImageFormat {
  kUnknown,
  kExr,
  kPng,
  kJpeg,
  kTiff,
  kHdr,  // Radiance
  kWebp,
  kHeif,  // HEIC, as telephones write it, and AVIF
  kOther  // recognised, and nothing that is read here
};

struct RecognizedFormat {
  ImageFormat format = ImageFormat::kUnknown;
  const char* name = "";  // for messages, with its article: "a PNG image"; empty if unknown
};

RecognizedFormat recognize_format(std::string_view bytes);

}  // namespace itn
