// Counter-based random numbers: a function of (seed, pixel, sample, dimension), so that nothing
// depends on the order in which samples are computed.
//
// A dimension is a vertex of the path (0 the camera, 1 the end of the first flight, ...) and a
// purpose there; it has five uniform numbers, u0 .. u4. Who uses which, so that none is used twice:
//
//   vertex  purpose     u0, u1            u2        u3              u4
//   0       kFilm       film position     flight 1  -               -
//   n       kWalk       flight, angle     azimuth   roulette        -
//   n       kShadowRay  light, cell       a coin    a direction     roulette of the wavefront
//   n       kMap        a pixel           a coin    -               -
//   n       kBoundary   whatever the boundary makes of u0 .. u4
//   n       kOutline    a place       -         -               -
//
// In the wavefront, film position and first flight are rather the three coordinates of a scrambled
// Sobol sequence (common/low_discrepancy.h), whose scrambles are drawn by kSequence.
#pragma once

#include <array>
#include <cstdint>

namespace itn::tracer {

// Philox4x32: Salmon, Moraes, Dror, Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011.
// With the seven rounds of which they find that they pass all tests of BigCrush.
constexpr int kPhiloxRounds = 7;
template <int rounds = kPhiloxRounds>
std::array<uint32_t, 4> philox(std::array<uint32_t, 4> counter, std::array<uint32_t, 2> key) {
  for (int round = 0; round < rounds; ++round) {
    const uint64_t a = uint64_t{0xD2511F53} * counter[0];
    const uint64_t b = uint64_t{0xCD9E8D57} * counter[2];
    counter = {static_cast<uint32_t>(b >> 32) ^ counter[1] ^ key[0], static_cast<uint32_t>(b),
               static_cast<uint32_t>(a >> 32) ^ counter[3] ^ key[1], static_cast<uint32_t>(a)};
    key[0] += 0x9E3779B9;
    key[1] += 0xBB67AE85;
  }
  return counter;
}

// Numbers in [0, 1), multiples of 2^-24, so that 1 - u is in (0, 1] exactly.
using Uniforms = std::array<float, 5>;

using RandomWords = std::array<uint32_t, 4>;

// The random numbers of one sample of one pixel.
class Sampler {
 public:
  enum Purpose : uint32_t {
    kFilm,
    kWalk,
    kShadowRay,
    kMap,
    kSequence,
    kBoundary,
    kRefraction,
    kOutline
  };

  Sampler(uint64_t seed, uint32_t pixel, uint32_t sample)
      : key_{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)},
        pixel_(pixel),
        sample_(sample) {}

  RandomWords words(uint32_t vertex, uint32_t purpose) const {
    return philox({vertex, purpose, sample_, pixel_}, key_);
  }
  // The upper 24 bits of four words, and the lower 8 bits of three.
  Uniforms uniforms(uint32_t vertex, uint32_t purpose) const {
    const RandomWords bits = words(vertex, purpose);
    Uniforms u;
    for (size_t i = 0; i < 4; ++i) u[i] = static_cast<float>(bits[i] >> 8) * 0x1p-24F;
    u[4] = static_cast<float>((bits[0] & 255) << 16 | (bits[1] & 255) << 8 | (bits[2] & 255)) *
           0x1p-24F;
    return u;
  }

 private:
  std::array<uint32_t, 2> key_;
  uint32_t pixel_, sample_;
};

}  // namespace itn::tracer
