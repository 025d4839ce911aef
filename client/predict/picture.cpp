#include "client/predict/picture.h"

#include <algorithm>
#include <cstddef>

#include "client/image/preview.h"
#include "common/learning/weight_map.h"

namespace itn {
namespace {

constexpr Rgb kOutline{255, 128, 0};
constexpr float kOutside = 0.12F;  // of its light is left of what is not the object

// The luminance of linear sRGB, or the only channel.
float luminance(std::span<const float> pixel) {
  return pixel.size() == 1 ? pixel[0]
                           : 0.2126F * pixel[0] + 0.7152F * pixel[1] + 0.0722F * pixel[2];
}

Rgb colour(std::span<const float> pixel, float factor) {
  return {to_srgb_byte(pixel.front() * factor), to_srgb_byte(pixel[pixel.size() / 2] * factor),
          to_srgb_byte(pixel.back() * factor)};
}

// A framed photograph by its pixels.
class Pixels {
 public:
  explicit Pixels(const FramedPhotograph& photograph)
      : photograph_(photograph), channels_(static_cast<size_t>(photograph.channels)) {}

  size_t count() const { return photograph_.mask.size(); }
  std::span<const float> pixel(std::span<const float> interleaved, size_t p) const {
    return interleaved.subspan(p * channels_, channels_);
  }
  std::span<const float> operator[](size_t p) const { return pixel(photograph_.pixels, p); }
  bool on_object(size_t p) const { return is_on_object(photograph_.mask[p]); }

  // On the object, and beside what is not.
  bool on_outline(size_t p) const {
    const auto side = static_cast<size_t>(photograph_.side);
    const size_t x = p % side, y = p / side;
    return on_object(p) &&
           (x == 0 || y == 0 || x + 1 == side || y + 1 == side || !on_object(p - 1) ||
            !on_object(p + 1) || !on_object(p - side) || !on_object(p + side));
  }

  // The level that is shown as white.
  float white() const {
    std::vector<float> values;
    for (size_t p = 0; p < count(); ++p) {
      const std::span<const float> pixel = (*this)[p];
      if (on_object(p)) values.insert(values.end(), pixel.begin(), pixel.end());
    }
    return white_level(values);
  }

  // Over the object.
  double mean_luminance(std::span<const float> interleaved) const {
    double sum = 0, weight = 0;
    for (size_t p = 0; p < count(); ++p) {
      sum += static_cast<double>(photograph_.mask[p]) * luminance(pixel(interleaved, p));
      weight += photograph_.mask[p];
    }
    return sum / weight;
  }

 private:
  const FramedPhotograph& photograph_;
  size_t channels_;
};

// The colour of a body that is heated.
Rgb heat(float weight) {
  return {to_byte(3 * weight), to_byte(3 * weight - 1), to_byte(3 * weight - 2)};
}

std::vector<float> weights_of(const FramedPhotograph& photograph) {
  const Pixels pixels(photograph);
  std::vector<float> luminances;
  for (size_t p = 0; p < pixels.count(); ++p) luminances.push_back(luminance(pixels[p]));
  return weight_map(photograph.side, photograph.side, luminances, photograph.mask);
}

// From radiance to the scale of the photograph.
double scale_of(const PredictInput& photograph, std::span<const float> rendered) {
  const v1::Capture& capture = photograph.capture;
  if (capture.has_exposure()) return 1 / capture.exposure();
  if (!capture.encoded() && capture.white_size() == 0) return 1;
  const Pixels pixels(photograph.photograph);
  const double mean = pixels.mean_luminance(rendered);
  return mean > 0 ? pixels.mean_luminance(photograph.photograph.pixels) / mean : 1;
}

}  // namespace

PanelRow network_view_panels(const PredictInput& photograph) {
  const FramedPhotograph& framed = photograph.photograph;
  const Pixels pixels(framed);
  const float white = pixels.white();
  const std::vector<float> weights = weights_of(framed);
  PanelRow row(3, {.side = framed.side, .pixels = {}});
  for (size_t p = 0; p < pixels.count(); ++p) {
    const float left = kOutside + (1 - kOutside) * framed.mask[p];
    row[0].pixels.push_back(colour(pixels[p], 1 / white));
    row[1].pixels.push_back(pixels.on_outline(p) ? kOutline : colour(pixels[p], left / white));
    row[2].pixels.push_back(heat(weights[p]));
  }
  return row;
}

PanelRow rerendered_panels(const PredictInput& photograph, std::span<const float> rendered) {
  const FramedPhotograph& framed = photograph.photograph;
  const Pixels pixels(framed);
  const float white = pixels.white();
  const float factor = static_cast<float>(scale_of(photograph, rendered)) / white;
  PanelRow row(2, {.side = framed.side, .pixels = {}});
  for (size_t p = 0; p < pixels.count(); ++p) {
    const std::span<const float> again = pixels.pixel(rendered, p);
    const float mask = framed.mask[p], brightness = luminance(again) * factor;
    row[0].pixels.push_back(colour(again, factor));
    row[1].pixels.push_back(
        diverging(mask > 0 ? mask * (brightness - luminance(pixels[p]) / white) : brightness));
  }
  return row;
}

}  // namespace itn
