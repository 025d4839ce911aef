#include "client/predict/photograph_input.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <set>
#include <string_view>
#include <utility>

#include "client/image/background_mask.h"
#include "client/image/channels.h"
#include "client/image/mask_parts.h"
#include "client/image/photograph_file.h"
#include "client/interrupt.h"
#include "common/error.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// By which the photographs in a folder, and the mask of one, are known.
constexpr std::array<std::string_view, 11> kExtensions = {
    ".exr", ".hdr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".heic", ".heif", ".avif"};

bool is_photograph(const fs::path& path) {
  std::string extension = path.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::ranges::find(kExtensions, extension) != kExtensions.end();
}

// Channels interleaved.
std::vector<float> pixels_of(const PhotographContent& content) {
  std::vector<float> pixels;
  const size_t count = content.file.image.channel(content.channels[0]).size();
  pixels.reserve(count * content.channels.size());
  for (size_t p = 0; p < count; ++p) {
    for (const std::string& channel : content.channels) {
      pixels.push_back(content.file.image.channels.at(channel)[p]);
    }
  }
  return pixels;
}

// A linear file ends where its pixels are clipped, wherever that is: many of them have its largest
// value, while others have many. Drawings have few values in all.
void mark_plateaus(PhotographContent& content) {
  constexpr size_t kPlateau = 16, kFewValues = 64;
  constexpr double kPart = 2e-3;  // of the pixels
  for (const std::string& channel : content.channels) {
    const std::vector<float>& plane = content.file.image.channel(channel);
    const float most = *std::ranges::max_element(plane);
    const auto at_most = static_cast<size_t>(std::ranges::count(plane, most));
    const auto few = static_cast<size_t>(kPart * static_cast<double>(plane.size()));
    if (!(most > 0) || at_most < std::max(kPlateau, few)) continue;
    std::set<float> values;
    for (size_t p = 0; p < plane.size() && values.size() <= kFewValues; ++p)
      values.insert(plane[p]);
    if (values.size() <= kFewValues) continue;
    content.file.clipped.resize(plane.size());
    for (size_t p = 0; p < plane.size(); ++p) {
      if (plane[p] == most) content.file.clipped[p] = 1;
    }
  }
}

// --- Where the object is ---

// The part of the photograph that is the object's, and of its border.
struct Coverage {
  double all = 0, border = 0;
};

Coverage coverage_of(const std::vector<float>& mask, int width, int height) {
  size_t all = 0, border = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (!is_on_object(mask[static_cast<size_t>(y) * width + x])) continue;
      ++all;
      if (x == 0 || y == 0 || x == width - 1 || y == height - 1) ++border;
    }
  }
  return {static_cast<double>(all) / static_cast<double>(mask.size()),
          static_cast<double>(border) / std::max(1, 2 * (width + height) - 4)};
}

// A soft brush, or a veil, leaves gray where white is meant.
void brighten(std::vector<float>& mask, const std::string& path, const std::string& name) {
  constexpr float kMinBrightness = 0.1F;
  constexpr float kWhite = 0.98F;
  const float most = std::ranges::max(mask);
  if (most >= kWhite) return;
  if (most < kMinBrightness) {
    throw invalid_input(
        fmt::format("{}: the mask {} is black: its brightest value is {:.4g} of white ({:.0f} of "
                    "255); white is "
                    "the object, and a mask of labels is to be made one of black and white",
                    name, path, most, 255 * most));
  }
  spdlog::warn("{}: its brightest value is {:.2g} of white; that is taken for the object", path,
               most);
  for (float& value : mask) value /= most;
}

std::vector<float> mask_of_background(const PhotographContent& content, const std::string& name) {
  std::vector<float> mask =
      mask_from_background(content.width(), content.height(),
                           static_cast<int>(content.channels.size()), pixels_of(content));
  const Coverage coverage = coverage_of(mask, content.width(), content.height());
  spdlog::warn(
      "{}: what differs from the background is {:.0f} % of the photograph{}; a shadow may be taken "
      "for the object: look at --picture",
      name, 100 * coverage.all,
      coverage.border > 0 ? ", touches its border, and so may be no object at all" : "");
  return mask;
}

// Alpha that is 1 everywhere says nothing.
bool has_mask(const std::vector<float>& alpha) {
  return std::ranges::any_of(alpha, [](float a) { return !is_on_object(a); });
}

std::vector<float> mask_of(const PhotographContent& content, const std::string& name,
                           const PhotographOptions& options) {
  if (!options.mask.empty()) return read_mask_for(content, name, options.mask);
  if (options.mask_by_background) return mask_of_background(content, name);
  const Image& image = content.file.image;
  if (image.has("mask.Y")) return image.channel("mask.Y");
  const std::string alpha = alpha_beside(content.channels.front());
  if (image.has(alpha) && has_mask(image.channel(alpha))) {
    std::vector<float> mask = image.channel(alpha);
    brighten(mask, "the alpha of " + name, name);
    return mask;
  }
  throw invalid_input(fmt::format(
      "{} has neither a channel mask.Y nor a transparent background that say where the object is; "
      "give a mask with --mask, or, if the background is plain, --background auto",
      name));
}

// --- What is known of its light ---

v1::Capture capture_of(const MarkedPhotograph& marked, const std::string& name,
                       const PhotographOptions& options) {
  v1::Capture capture;
  if (options.object_size) capture.set_object_size(*options.object_size);
  if (options.exposure) capture.set_exposure(*options.exposure);
  if (options.gray_card) {
    const std::vector<double> white = white_of_card(marked, name, options);
    capture.mutable_white()->Assign(white.begin(), white.end());
  }
  capture.set_clipped(clipped_part(marked.content.file.clipped, marked.mask));
  capture.set_cut_by_frame(reaches_edge(marked.view()));
  capture.set_encoded(marked.content.file.encoded);
  return capture;
}

// Renders, which have their mask with them, are framed as they should be; photographs as it came.
Framing framing_of(const PhotographOptions& options, const Image& image) {
  return options.framing.value_or(image.has("mask.Y") ? Framing::kSquareWhole : Framing::kObject);
}

}  // namespace

double clipped_part(const std::vector<unsigned char>& clipped, const std::vector<float>& mask) {
  size_t object = 0, both = 0;
  for (size_t p = 0; p < clipped.size(); ++p) {
    if (!is_on_object(mask[p])) continue;
    ++object;
    both += clipped[p];
  }
  return object == 0 ? 0 : static_cast<double>(both) / static_cast<double>(object);
}

PhotographContent read_content(const std::string& name, const FileReading& reading) {
  PhotographContent content;
  content.file = read_photograph(name, reading.is_linear);
  Image& image = content.file.image;
  content.channels = radiance_channels(image, name, reading.layer, "--layer says so");
  if (!content.file.encoded) mark_plateaus(content);
  size_t below = 0;
  float least = 0;
  for (const std::string& channel : content.channels) {
    for (float& value : image.channels.at(channel)) {
      if (!(value < 0)) continue;
      ++below;
      least = std::min(least, value);
      value = 0;
    }
  }
  if (below > 0) {
    spdlog::warn("{}: {} values are below 0, the least {:.2g}; they count as 0", name, below,
                 least);
  }
  return content;
}

std::string mask_in_folder(const std::string& masks, const std::string& name) {
  const fs::path folder = masks;
  const fs::path stem = fs::path(name).stem();
  const fs::path same = folder / fs::path(name).filename();
  if (fs::exists(same)) return same.string();
  std::vector<std::string> found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (entry.path().stem() == stem && is_photograph(entry.path())) {
      found.push_back(entry.path().string());
    }
  }
  if (found.empty()) {
    throw Error(ErrorKind::kIo,
                fmt::format("there is no mask of {} in {}: {}.png, or another image of that name",
                            name, folder.string(), stem.string()));
  }
  if (found.size() > 1) {
    std::ranges::sort(found);
    throw Error(ErrorKind::kIo,
                fmt::format("which of them is the mask of {}: {}?", name, fmt::join(found, ", ")));
  }
  return found.front();
}

std::vector<float> read_mask_for(const PhotographContent& content, const std::string& name,
                                 const std::string& mask) {
  const std::string path = fs::is_directory(mask) ? mask_in_folder(mask, name) : mask;
  MaskFile file = read_mask(path);
  if (file.width != content.width() || file.height != content.height()) {
    throw invalid_input(fmt::format(
        "the mask {} is {} x {} pixels, {} is {} x {}; they must be the same{}", path, file.width,
        file.height, name, content.width(), content.height(),
        content.file.turned && !file.turned
            ? " (the photograph was turned upright, as its EXIF says; turn the mask, too)"
            : ""));
  }
  if (content.file.turned && !file.turned) {
    spdlog::warn("{} was turned upright, as its EXIF says; the mask {} was not", name, path);
  }
  brighten(file.values, path, name);
  constexpr double kMuch = 0.9;
  const Coverage coverage = coverage_of(file.values, file.width, file.height);
  if (coverage.all > kMuch || coverage.border > kMuch) {
    throw invalid_input(fmt::format(
        "the mask {} covers {:.0f} % of the photograph and {:.0f} % of its border: is it inverted? "
        "White is the object, black what is around it",
        path, 100 * coverage.all, 100 * coverage.border));
  }
  const MaskParts parts = drop_specks(file.values, file.width, file.height);
  if (parts.specks > 0) {
    spdlog::warn("{}: specks beside the object were left out: {}, of {} pixels in all", path,
                 parts.specks, parts.speck_pixels);
  }
  if (parts.parts > 1) {
    spdlog::warn("{}: it is in {} parts, which are taken for one object", path, parts.parts);
  }
  // An object that fills the photograph, or a rectangle of it, with a hole: it is rather what is
  // around the object.
  constexpr double kFilled = 0.85, kRectangle = 0.5, kHole = 0.05;
  const bool fills = parts.filled > kFilled || (parts.filled > kRectangle && parts.is_rectangle);
  if (fills && parts.largest_hole > kHole) {
    throw invalid_input(fmt::format(
        "the mask {} surrounds {:.0f} % of the photograph and leaves out {:.0f} % in its middle: "
        "is it inverted? White is the object, black what is around it",
        path, 100 * parts.filled, 100 * parts.largest_hole));
  }
  return std::move(file.values);
}

std::vector<double> white_of_card(const MarkedPhotograph& marked, const std::string& name,
                                  const PhotographOptions& options) {
  const PixelRectangle& card = options.gray_card.value();
  const auto& [content, pixels, mask] = marked;
  const auto wrong = [&](const std::string& what) {
    return invalid_input(fmt::format("the gray card {},{},{},{} of {} {}", card.x, card.y,
                                     card.width, card.height, name, what));
  };
  if (card.x + card.width > content.width() || card.y + card.height > content.height()) {
    throw wrong(
        fmt::format("is not inside of its {} x {} pixels", content.width(), content.height()));
  }
  std::vector<double> sums(content.channels.size()), squares = sums;
  size_t clipped = 0;
  for (int y = card.y; y < card.y + card.height; ++y) {
    for (int x = card.x; x < card.x + card.width; ++x) {
      const size_t p =
          static_cast<size_t>(y) * static_cast<size_t>(content.width()) + static_cast<size_t>(x);
      if (is_on_object(mask[p])) throw wrong("overlaps the object");
      if (!content.file.clipped.empty()) clipped += content.file.clipped[p];
      for (size_t c = 0; c < sums.size(); ++c) {
        const double value{pixels[p * sums.size() + c]};
        sums[c] += value;
        squares[c] += value * value;
      }
    }
  }
  const double area = static_cast<double>(card.width) * card.height;
  if (static_cast<double>(clipped) > kMuchClipped * area) {
    throw wrong("is overexposed: it is as bright as the file can hold; expose less");
  }
  constexpr double kFewPixels = 16, kUneven = 0.2, kNoCard = 0.5;  // deviations over the mean
  double deviation = 0;
  for (size_t c = 0; c < sums.size(); ++c) {
    const double mean = sums[c] / area;
    if (!(mean > 0)) throw wrong("is black");
    deviation =
        std::max(deviation, std::sqrt(std::max(0.0, squares[c] / area - mean * mean)) / mean);
    sums[c] /= area * options.gray;
  }
  if (deviation > kNoCard) {
    throw wrong(fmt::format(
        "is no card: its pixels differ by {:.0f} % of their mean; X,Y,W,H are to lie on the card "
        "alone, and it must be lit",
        100 * deviation));
  }
  if (area < kFewPixels || deviation > kUneven) {
    spdlog::warn("the gray card {},{},{},{} of {} {}: is the rectangle on the card alone?", card.x,
                 card.y, card.width, card.height, name,
                 area < kFewPixels
                     ? "has few pixels"
                     : fmt::format("is uneven, by {:.0f} % of its mean", 100 * deviation));
  }
  return sums;
}

MarkedPhotograph read_marked(const std::string& file, const PhotographOptions& options) {
  MarkedPhotograph marked{.content = read_content(file, options.reading), .pixels = {}, .mask = {}};
  const PhotographContent& content = marked.content;
  marked.pixels = pixels_of(content);
  warn_if_taken_for_srgb(content.file, file);
  if (options.exposure && !options.reading.knows_curve(content.file.encoded)) {
    throw invalid_input(fmt::format(
        "{}: a scale of radiance (--radiance-scale) is for linear images; this one is encoded for "
        "a screen, by a curve and an exposure that nobody knows. Leave the scale out, put a gray "
        "card beside the object (--gray-card), or say the curve (--encoding)",
        file));
  }
  marked.mask = mask_of(content, file, options);
  try {
    validate(marked.view(), interruption());
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", file, error.what()));
  }
  return marked;
}

PredictInput load_photograph(const std::string& file, const PhotographOptions& options) {
  const MarkedPhotograph marked = read_marked(file, options);
  const PhotographContent& content = marked.content;
  const Photograph photograph = marked.view();
  return {.name = file,
          .channels = content.channels,
          .photograph = framed(photograph, interruption(), framing_of(options, content.file.image)),
          .capture = capture_of(marked, file, options),
          .width = content.width(),
          .height = content.height()};
}

std::vector<std::string> photograph_files(const std::vector<std::string>& arguments) {
  std::vector<std::string> files;
  for (const std::string& argument : arguments) {
    if (!fs::is_directory(argument)) {
      files.push_back(argument);
      continue;
    }
    std::vector<std::string> inside;
    for (const fs::directory_entry& entry : fs::directory_iterator(argument)) {
      if (is_photograph(entry.path())) inside.push_back(entry.path().string());
    }
    if (inside.empty()) {
      throw Error(ErrorKind::kIo, fmt::format("there is no photograph ({}) in {}",
                                              fmt::join(kExtensions, ", "), argument));
    }
    std::ranges::sort(inside);
    files.insert(files.end(), inside.begin(), inside.end());
  }
  return files;
}

}  // namespace itn
