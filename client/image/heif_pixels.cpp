#include <fmt/format.h>
#include <libheif/heif.h>

#include <algorithm>
#include <cstring>
#include <memory>

#include "client/image/encoded_pixels.h"
#include "common/error.h"
#include "common/releaser.h"

namespace itn {
namespace {

using Context = std::unique_ptr<heif_context, Releaser<heif_context_free>>;
using Handle = std::unique_ptr<heif_image_handle, Releaser<heif_image_handle_release>>;
using Decoded = std::unique_ptr<heif_image, Releaser<heif_image_release>>;

// Throws where a call of libheif's has failed.
class Check {
 public:
  Check(const PhotographHeader& header, const std::string& name) : header_(header), name_(name) {}

  void operator()(const heif_error& result) const {
    if (result.code == heif_error_Ok) return;
    if (result.code == heif_error_Unsupported_filetype ||
        result.code == heif_error_Unsupported_feature) {
      throw invalid_input(fmt::format("{} is {} of a kind that is not read: {}; save it as PNG",
                                      name_, header_.format_name, result.message));
    }
    throw damaged(name_, header_, result.message);
  }

 private:
  const PhotographHeader& header_;
  const std::string& name_;
};

// The block begins with the offset of what follows it (ISO/IEC 23008-12, annex A.2.1). Pixels come
// upright from libheif, whatever EXIF says.
Exif exif_of(const heif_image_handle* handle) {
  heif_item_id block = 0;
  if (heif_image_handle_get_list_of_metadata_block_IDs(handle, "Exif", &block, 1) != 1) return {};
  std::string bytes(heif_image_handle_get_metadata_size(handle, block), '\0');
  if (bytes.size() < 4 ||
      heif_image_handle_get_metadata(handle, block, bytes.data()).code != heif_error_Ok) {
    return {};
  }
  size_t offset = 0;  // of the TIFF header behind these four bytes
  for (size_t i = 0; i < 4; ++i) offset = offset << 8U | static_cast<unsigned char>(bytes[i]);
  if (offset > bytes.size() - 4) return {};
  std::string_view tiff = std::string_view(bytes).substr(4 + offset);
  if (tiff.starts_with("Exif")) tiff.remove_prefix(std::min<size_t>(6, tiff.size()));
  const auto directory = TiffDirectory::first(tiff);
  Exif exif = directory ? read_exif(*directory) : Exif{};
  exif.orientation = 1;
  return exif;
}

// A profile, or code points.
ColourEncoding encoding_of(const heif_image_handle* handle, const Check& check,
                           const std::string& name) {
  ColourEncoding encoding;
  encoding.is_stated = true;
  const heif_color_profile_type type = heif_image_handle_get_color_profile_type(handle);
  if (type == heif_color_profile_type_prof || type == heif_color_profile_type_rICC) {
    encoding.profile.resize(heif_image_handle_get_raw_color_profile_size(handle));
    check(heif_image_handle_get_raw_color_profile(handle, encoding.profile.data()));
  } else if (type == heif_color_profile_type_nclx) {
    heif_color_profile_nclx* found = nullptr;
    check(heif_image_handle_get_nclx_color_profile(handle, &found));
    const std::unique_ptr<heif_color_profile_nclx, Releaser<heif_nclx_color_profile_free>> nclx(
        found);
    encoding = encoding_of_code_points(static_cast<int>(nclx->color_primaries),
                                       static_cast<int>(nclx->transfer_characteristics), name);
  }
  return encoding;
}

// Values of `bits` as those of 16.
std::vector<uint16_t> widened(std::vector<uint16_t> values, int bits) {
  for (uint16_t& value : values) {
    value = static_cast<uint16_t>(value << (16 - bits) | value >> (2 * bits - 16));
  }
  return values;
}

}  // namespace

EncodedPixels decode_heif_pixels(std::string_view bytes, const PhotographHeader& header,
                                 const std::string& name) {
  const Check check(header, name);
  const Context context(heif_context_alloc());
  heif_context_set_maximum_image_size_limit(context.get(), static_cast<int>(kMaxPhotographSide));
  heif_context_set_max_decoding_threads(context.get(), 0);  // in this one
  check(heif_context_read_from_memory_without_copy(context.get(), bytes.data(), bytes.size(),
                                                   nullptr));
  heif_image_handle* primary = nullptr;
  check(heif_context_get_primary_image_handle(context.get(), &primary));
  const Handle handle(primary);
  const bool alpha = heif_image_handle_has_alpha_channel(handle.get()) != 0;
  const bool is_deep = heif_image_handle_get_luma_bits_per_pixel(handle.get()) > 8;
  const heif_chroma chroma =
      is_deep ? (alpha ? heif_chroma_interleaved_RRGGBBAA_LE : heif_chroma_interleaved_RRGGBB_LE)
              : (alpha ? heif_chroma_interleaved_RGBA : heif_chroma_interleaved_RGB);
  heif_image* image = nullptr;
  check(heif_decode_image(handle.get(), &image, heif_colorspace_RGB, chroma, nullptr));
  const Decoded decoded(image);

  int stride = 0;
  const uint8_t* plane =
      heif_image_get_plane_readonly(decoded.get(), heif_channel_interleaved, &stride);
  if (plane == nullptr) throw damaged(name, header, "it has no pixels");
  EncodedPixels pixels{
      .width = heif_image_get_width(decoded.get(), heif_channel_interleaved),
      .height = heif_image_get_height(decoded.get(), heif_channel_interleaved),
      .channels = alpha ? 4 : 3,
      .values = {},
      .encoding = encoding_of(handle.get(), check, name),
      .multiplied_by_alpha = heif_image_handle_is_premultiplied_alpha(handle.get()) != 0,
      .exif = exif_of(handle.get())};
  const auto row = static_cast<size_t>(pixels.width) * static_cast<size_t>(pixels.channels);
  const auto rows_of = [&]<typename T>(std::vector<T> values) {
    values.resize(row * static_cast<size_t>(pixels.height));
    for (size_t y = 0; y < static_cast<size_t>(pixels.height); ++y) {
      std::memcpy(&values[y * row], plane + y * static_cast<size_t>(stride), row * sizeof(T));
    }
    return values;
  };
  if (is_deep) {
    const int bits = heif_image_get_bits_per_pixel_range(decoded.get(), heif_channel_interleaved);
    if (bits <= 8 || bits > 16) throw damaged(name, header, "its parts disagree about their bits");
    pixels.values = widened(rows_of(std::vector<uint16_t>()), bits);
  } else {
    pixels.values = rows_of(std::vector<uint8_t>());
  }
  return pixels;
}

}  // namespace itn
