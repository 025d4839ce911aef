// Radiance HDR files: Ward, "Real pixels", Graphics Gems II; and the format's own description,
// which comes with Radiance ("File formats").
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>

#include "client/image/image.h"
#include "client/image/upright.h"
#include "common/error.h"

namespace itn {
namespace {

constexpr int kMaxSide = 16384;
// At most: runs of 127 equal values take two bytes, and a pixel has four.
constexpr int64_t kMostPixelsPerByte = 16;

using Rgbe = std::array<uint8_t, 4>;

Error damaged_hdr(const std::string& name, const std::string& reason) {
  return {
      ErrorKind::kDataLoss,
      fmt::format("{} begins as a Radiance HDR image and is not a complete one: {}", name, reason)};
}

struct Header {
  int lines = 0, line_pixels = 0;  // as they are in the file
  int orientation = 1;             // as of TIFF
  double exposure = 1;             // that the values were multiplied by
  std::array<double, 3> colours{1, 1, 1};
};

// Takes a line off the front.
std::string_view take_line(std::string_view& rest, const std::string& name) {
  const size_t end = rest.find('\n');
  if (end == std::string_view::npos) throw damaged_hdr(name, "it was cut short");
  const std::string_view line = rest.substr(0, end);
  rest.remove_prefix(end + 1);
  return line;
}

std::string_view take_word(std::string_view& rest) {
  rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size()));
  const std::string_view word = rest.substr(0, rest.find(' '));
  rest.remove_prefix(word.size());
  return word;
}

double positive(std::string_view text, const std::string& name) {
  double value = 0;
  const std::string_view word = take_word(text);
  std::from_chars(word.data(), word.data() + word.size(), value);
  if (!(value > 0 && std::isfinite(value))) {
    throw damaged_hdr(name, fmt::format("\"{}\" in its header is not above 0", word));
  }
  return value;
}

// The first axis is that of the lines: "-Y 3 +X 4" has three, of four pixels, from the top down and
// from left to right.
void read_size(std::string_view line, Header& header, const std::string& name) {
  const auto axis = [&](int& count) {
    const std::string_view sign_and_name = take_word(line), digits = take_word(line);
    std::from_chars(digits.data(), digits.data() + digits.size(), count);
    if (count > kMaxSide) {
      throw invalid_input(
          fmt::format("{} has {} pixels a side; at most {} are accepted", name, count, kMaxSide));
    }
    return count >= 1 ? sign_and_name : std::string_view();
  };
  const std::string_view of_lines = axis(header.lines), of_pixels = axis(header.line_pixels);
  const std::string sides = fmt::format("{} {}", of_lines, of_pixels);
  constexpr std::array kOrientations{"-Y +X", "-Y -X", "+Y -X", "+Y +X",
                                     "+X -Y", "-X -Y", "-X +Y", "+X +Y"};
  const auto found = std::ranges::find(kOrientations, sides);
  if (found == kOrientations.end()) throw damaged_hdr(name, "it has no size");
  header.orientation = static_cast<int>(found - kOrientations.begin()) + 1;
}

// Primaries are those of Radiance, by default, or of sRGB, which hardly differ: x and y of red,
// green, blue, white.
void check_primaries(std::string_view line, const std::string& name) {
  constexpr std::array kRadiance{0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 1.0 / 3, 1.0 / 3};
  constexpr std::array kSrgb{0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329};
  constexpr double kRounding = 2e-3;
  std::array<double, 8> given{};
  for (double& value : given) {
    const std::string_view word = take_word(line);
    std::from_chars(word.data(), word.data() + word.size(), value);
  }
  const auto are = [&](const std::array<double, 8>& known) {
    return std::ranges::equal(given, known,
                              [](double a, double b) { return std::abs(a - b) <= kRounding; });
  };
  if (are(kRadiance) || are(kSrgb)) return;
  throw invalid_input(
      fmt::format("{} is a Radiance HDR image of other primaries (PRIMARIES) than those of sRGB, "
                  "which is not read; convert it to these",
                  name));
}

// Whatever follows it is left.
Header read_header(std::string_view& rest, const std::string& name) {
  Header header;
  for (auto line = take_line(rest, name); !line.empty(); line = take_line(rest, name)) {
    if (line.starts_with("FORMAT=") && !line.starts_with("FORMAT=32-bit_rle_rgbe")) {
      throw invalid_input(fmt::format(
          "{} is a Radiance HDR image of another colour space than RGB, which is not read; save it "
          "as RGB",
          name));
    }
    if (line.starts_with("PRIMARIES=")) check_primaries(line.substr(10), name);
    if (line.starts_with("GAMMA=") && positive(line.substr(6), name) != 1) {
      throw invalid_input(fmt::format(
          "{} is a Radiance HDR image with a GAMMA, which is not read; save it as linear", name));
    }
    if (line.starts_with("PIXASPECT=") && std::abs(positive(line.substr(10), name) - 1) > 1e-3) {
      throw invalid_input(
          fmt::format("{} has pixels that are not square (PIXASPECT), which is not "
                      "read; resample it",
                      name));
    }
    if (line.starts_with("EXPOSURE=")) header.exposure *= positive(line.substr(9), name);
    if (line.starts_with("COLORCORR=")) {
      std::string_view factors = line.substr(10);
      for (double& colour : header.colours) colour *= positive(take_word(factors), name);
    }
  }
  read_size(take_line(rest, name), header, name);
  return header;
}

// A line of pixels, which are as they are, in runs that a pixel (1, 1, 1, N) repeats, or by channel
// in runs.
class Lines {
 public:
  Lines(std::string_view bytes, const std::string& name) : rest_(bytes), name_(name) {}

  void read(std::vector<Rgbe>& line) {
    const Rgbe first = pixel();
    const size_t claimed = size_t{first[2]} << 8U | first[3];
    if (line.size() >= 8 && line.size() < 32768 && first[0] == 2 && first[1] == 2 &&
        first[2] < 128) {
      if (claimed != line.size()) throw damaged_hdr(name_, "its lines differ in length");
      for (size_t channel = 0; channel < 4; ++channel) read_channel(line, channel);
      return;
    }
    size_t filled = 0;
    int shift = 0;  // of how often the last pixel is repeated, if several pixels say so
    for (Rgbe next = first;; next = pixel()) {
      if (next[0] == 1 && next[1] == 1 && next[2] == 1) {
        const size_t count = shift < 32 ? size_t{next[3]} << shift : line.size();
        if (filled == 0 || count > line.size() - filled)
          throw damaged_hdr(name_, "a run is too long");
        for (size_t i = 0; i < count; ++i, ++filled) line[filled] = line[filled - 1];
        shift += 8;
      } else {
        line[filled++] = next;
        shift = 0;
      }
      if (filled == line.size()) return;
    }
  }

 private:
  uint8_t byte() {
    if (rest_.empty()) throw damaged_hdr(name_, "it was cut short");
    const auto value = static_cast<uint8_t>(rest_.front());
    rest_.remove_prefix(1);
    return value;
  }
  Rgbe pixel() {
    Rgbe value;
    for (uint8_t& part : value) part = byte();
    return value;
  }
  void read_channel(std::vector<Rgbe>& line, size_t channel) {
    for (size_t filled = 0; filled < line.size();) {
      const uint8_t code = byte();
      const bool run = code > 128;
      const size_t count = run ? code - 128U : code;
      if (count == 0 || count > line.size() - filled) throw damaged_hdr(name_, "a run is too long");
      const uint8_t repeated = run ? byte() : uint8_t{0};
      for (size_t i = 0; i < count; ++i) line[filled++][channel] = run ? repeated : byte();
    }
  }

  std::string_view rest_;
  const std::string& name_;
};

// In the middle of what a mantissa stands for.
float radiance_of(uint8_t mantissa, uint8_t exponent) {
  return exponent == 0 ? 0 : std::ldexp(static_cast<float>(mantissa) + 0.5F, exponent - 136);
}

}  // namespace

Image decode_hdr(std::string_view bytes, const std::string& name) {
  std::string_view rest = bytes;
  const Header header = read_header(rest, name);
  const int64_t pixels = int64_t{header.lines} * header.line_pixels;
  if (pixels > kMostPixelsPerByte * static_cast<int64_t>(rest.size())) {
    throw damaged_hdr(name, fmt::format("its header claims {} x {} pixels, the file has {} bytes",
                                        header.line_pixels, header.lines, bytes.size()));
  }
  const Upright to(header.orientation, header.line_pixels, header.lines);
  Image image{.width = to.width(), .height = to.height(), .channels = {}, .attributes = {}};
  std::vector<Rgbe> all;
  all.reserve(static_cast<size_t>(pixels));
  std::vector<Rgbe> line(static_cast<size_t>(header.line_pixels));
  Lines lines(rest, name);
  for (int y = 0; y < header.lines; ++y) {
    lines.read(line);
    all.insert(all.end(), line.begin(), line.end());
  }
  for (size_t c = 0; c < 3; ++c) {
    std::vector<float>& plane = image.channels[std::string(1, "RGB"[c])];
    plane.resize(all.size());
    const auto by = static_cast<float>(1 / (header.exposure * header.colours[c]));
    to.for_each([&](size_t pixel, size_t source) {
      plane[pixel] = radiance_of(all[source][c], all[source][3]) * by;
    });
  }
  check_finite(image, name);
  return image;
}

}  // namespace itn
