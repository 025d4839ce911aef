// A photograph of an object, and the square of it that a network sees.
#pragma once

#include <span>
#include <stop_token>
#include <vector>

namespace itn {

// With the object marked.
struct Photograph {
  int width = 0;
  int height = 0;
  int channels = 1;               // 1 or 3
  std::span<const float> pixels;  // linear radiance, >= 0, channels interleaved, top row first
  std::span<const float> mask;    // width * height in [0, 1], 1 on the object
};

// Whether a pixel of this mask is on the object.
inline bool is_on_object(float mask) {
  return mask > 0.5F;
}

// Throws Error (invalid input) that names what is wrong: sizes that do not fit, channels, NaN, a
// negative or infinite value (with its pixel), a mask without a pixel above 0.5, an object that is
// black in all channels. Throws Error (cancelled) within milliseconds of a stop, as framed() does.
void validate(const Photograph& photograph, const std::stop_token& stop = {});

// Whether the object reaches the edge of the photograph.
bool reaches_edge(const Photograph& photograph, const std::stop_token& stop = {});

// Whether a channel is 0 wherever the object is.
bool is_black(const Photograph& photograph, int channel, const std::stop_token& stop = {});

// Part of an object, or of a card, of which more should not be at the top of what a file can hold:
// less are glints that change nothing.
inline constexpr double kMuchClipped = 0.01;

// Which part of a photograph a network sees.
enum class Framing {
  kSquareWhole,  // of a square photograph the whole, of any other a square about the object
  kObject,       // a square about the object
};

// The square that a network sees has at most this side, a multiple of every network's resolution: a
// larger one holds nothing more for it.
inline constexpr int kMaxFrameSide = 256;

// In pixels from the photograph's left and top; it may reach beyond.
struct Square {
  int left = 0, top = 0, side = 0;
};

// A square photograph with its own storage.
struct FramedPhotograph {
  int side = 0;
  int channels = 1;
  std::vector<float> pixels;
  std::vector<float> mask;
  Square square = {};  // that it was, of the photograph that was framed

  Photograph view() const { return {side, side, channels, pixels, mask}; }
};

// A square photograph is taken whole, as framed like the images that the network was trained with.
// Of any other, a square about the mask is cut out in which the object's longer side takes the same
// part as there, as sigma_t is relative to the object's longest side of 1 mm; what of it lies
// outside of the photograph is black and not of the object. A square of a side above kMaxFrameSide
// is brought down to that by averaging over areas. Whoever frames a photograph that is framed gets
// the same again, bit for bit, so that a client may do it before it sends the photograph away.
//
// `photograph` must be valid. Takes memory for kMaxFrameSide^2 pixels, whatever its size.
FramedPhotograph framed(const Photograph& photograph, const std::stop_token& stop = {},
                        Framing framing = Framing::kSquareWhole);

// The square that framed() takes, before it is brought down.
Square frame(const Photograph& photograph, Framing framing = Framing::kSquareWhole,
             const std::stop_token& stop = {});

// A square of an image of `width` pixels a row (channels interleaved), averaged down to `side`
// pixels, at most its own; black beyond the image.
std::vector<float> averaged(std::span<const float> values, int channels, int width,
                            const Square& square, int side, const std::stop_token& stop = {});

// The whole of it, averaged down to `columns` x `rows` pixels, at most its own.
std::vector<float> averaged(std::span<const float> values, int channels, int width, int columns,
                            int rows, const std::stop_token& stop = {});

}  // namespace itn
