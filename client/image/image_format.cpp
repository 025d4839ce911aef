#include "client/image/image_format.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace itn {
namespace {

using namespace std::string_view_literals;

constexpr const char* kRaw = "a camera's raw file";

struct Signature {
  std::string_view text;
  size_t offset;
  RecognizedFormat means;
};

// The first that fits counts: the beginnings of some are those of others, and more.
constexpr auto kSignatures = std::to_array<Signature>({
    {"\x76\x2f\x31\x01"sv, 0, {ImageFormat::kExr, "an OpenEXR image"}},
    {"\x89PNG"sv, 0, {ImageFormat::kPng, "a PNG image"}},
    {"\xff\xd8\xff"sv, 0, {ImageFormat::kJpeg, "a JPEG image"}},
    {"CR\x02"sv, 8, {ImageFormat::kOther, kRaw}},  // Canon's CR2, otherwise a TIFF
    {"II*\0"sv, 0, {ImageFormat::kTiff, "a TIFF image"}},
    {"MM\0*"sv, 0, {ImageFormat::kTiff, "a TIFF image"}},
    {"II+\0"sv, 0, {ImageFormat::kOther, "a BigTIFF image"}},
    {"MM\0+"sv, 0, {ImageFormat::kOther, "a BigTIFF image"}},
    {"#?RADIANCE"sv, 0, {ImageFormat::kHdr, "a Radiance HDR image"}},
    {"#?RGBE"sv, 0, {ImageFormat::kHdr, "a Radiance HDR image"}},
    {"WEBPVP8"sv, 8, {ImageFormat::kWebp, "a WebP image"}},
    {"ftypheic"sv, 4, {ImageFormat::kHeif, "a HEIC image"}},
    {"ftypheix"sv, 4, {ImageFormat::kHeif, "a HEIC image"}},
    {"ftypmif1"sv, 4, {ImageFormat::kHeif, "a HEIF image"}},
    {"ftypavif"sv, 4, {ImageFormat::kHeif, "an AVIF image"}},
    {"ftypcrx "sv, 4, {ImageFormat::kOther, kRaw}},
    {"ftyp"sv, 4, {ImageFormat::kOther, "a film"}},
    {"FUJIFILMCCD-RAW"sv, 0, {ImageFormat::kOther, kRaw}},
    {"IIRO"sv, 0, {ImageFormat::kOther, kRaw}},
    {"IIRS"sv, 0, {ImageFormat::kOther, kRaw}},
    {"IIU\0"sv, 0, {ImageFormat::kOther, kRaw}},
    {"FOVb"sv, 0, {ImageFormat::kOther, kRaw}},
    {"GIF8"sv, 0, {ImageFormat::kOther, "a GIF image"}},
    {"BM"sv, 0, {ImageFormat::kOther, "a BMP image"}},
    {"8BPS"sv, 0, {ImageFormat::kOther, "a Photoshop document"}},
    {"jP  "sv, 4, {ImageFormat::kOther, "a JPEG 2000 image"}},
    {"JXL "sv, 4, {ImageFormat::kOther, "a JPEG XL image"}},
    {"\xff\x0a"sv, 0, {ImageFormat::kOther, "a JPEG XL image"}},
    {"%PDF"sv, 0, {ImageFormat::kOther, "a PDF document"}},
    {"PK\x03\x04"sv, 0, {ImageFormat::kOther, "a ZIP archive"}},
    {"\x1f\x8b"sv, 0, {ImageFormat::kOther, "a gzip archive"}},
});

}  // namespace

RecognizedFormat recognize_format(std::string_view bytes) {
  const auto found = std::ranges::find_if(kSignatures, [&](const Signature& signature) {
    return bytes.size() >= signature.offset &&
           bytes.substr(signature.offset).starts_with(signature.text);
  });
  return found == kSignatures.end() ? RecognizedFormat{} : found->means;
}

}  // namespace itn
