// Photographs, and masks, in the formats that people have. Beside these, OpenImageIO takes a moment
// to load: for programs that read photographs alone.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/image/image.h"

namespace itn {

struct PhotographFile {
  // Linear; upright, however the camera was held. Channels R, G and B, or Y; and A, by which the
  // colours are not multiplied, if the file has alpha. Of an OpenEXR file as decode_exr().
  Image image;
  // By pixel, 1 where a colour channel is at the top of what the file can hold, so that the light
  // may have been more. Empty for files of floating-point numbers, but for what itn merge found
  // clipped in every photograph.
  std::vector<unsigned char> clipped;
  // The file's values were taken through a curve, that of sRGB (IEC 61966-2-1) or of what the file
  // says, or it is merged from such.
  bool encoded = false;
  // It holds 16-bit integers and does not say how they are encoded: they were taken for sRGB, and
  // may be linear.
  bool may_be_linear = false;
  bool turned = false;  // EXIF said how the camera was held, and the image was turned upright
  // From EXIF, if they are there and positive.
  std::optional<double> exposure_seconds, f_number, iso;
  // In mm, of a camera whose image has a diagonal of 43.27 mm and the same angles of view.
  std::optional<double> focal_length_35mm;
};

// OpenEXR, PNG, JPEG, TIFF (its first image), Radiance HDR, HEIC and AVIF, and WebP without alpha,
// told by their content. ICC profiles, code points (cICP, nclx), gamma and primaries are honoured:
// what comes back is linear sRGB, where colours beyond it have negative parts. Without them,
// integers are taken for sRGB, floating-point numbers for linear. `is_linear`, if there, says
// instead of the file whether its values are linear, or sRGB; OpenEXR and HDR are linear.
//
// `name` is for messages. Throws Error: kDataLoss (no image, damaged, cut short, claims more than
// it can hold; of JPEG, TIFF, HDR, HEIC and WebP, which have no checksums, damage that leaves a
// proper file is not seen), kInvalidInput (something else than a photograph, or of a kind that is
// not read: CMYK, camera raw, animations; colours that are not read; more than 16384 pixels a side;
// NaN or infinite values, with channel and pixel). Nothing is allocated that the file is too small
// to fill.
PhotographFile decode_photograph(std::string_view bytes, const std::string& name,
                                 std::optional<bool> is_linear = {});
// Decodes the photograph in a file; "-" is standard input. Throws Error of kIo, too, as
// read_file_or_stdin().
PhotographFile read_photograph(const std::filesystem::path& path,
                               std::optional<bool> is_linear = {});

// Says so of a file that may_be_linear; `name` is the file's.
void warn_if_taken_for_srgb(const PhotographFile& file, const std::string& name);

struct MaskFile {
  int width = 0;
  int height = 0;
  std::vector<float> values;  // width * height, top row first
  bool turned = false;        // as of PhotographFile
};

// The mask of an OpenEXR file is mask_channel() (client/image/channels.h). That of the other
// formats, upright too, is alpha if it is not the same everywhere, or else the gray value; integers
// over the largest one, as they are, without a curve. Throws as decode_photograph(), and
// kInvalidInput if it has colours.
MaskFile decode_mask(std::string_view bytes, const std::string& name);
MaskFile read_mask(const std::filesystem::path& path);

}  // namespace itn
