// Three numbers for every sample of a pixel that fill the cube more evenly than independent ones:
// Sobol's points, scrambled by Owen's nested permutations so that each is uniform by itself and
// estimates stay unbiased. Sobol, "On the distribution of points in a cube", 1967; Owen, "Randomly
// permuted (t,m,s)-nets and (t,s)-sequences", 1995; the permutations by hashing are those of
// Burley, "Practical hash-based Owen scrambling", JCGT 2020.
#pragma once

#include <array>
#include <cstdint>

namespace itn::tracer {

constexpr uint32_t reversed_bits(uint32_t x) {
  x = (x & 0x55555555) << 1 | (x >> 1 & 0x55555555);
  x = (x & 0x33333333) << 2 | (x >> 2 & 0x33333333);
  x = (x & 0x0F0F0F0F) << 4 | (x >> 4 & 0x0F0F0F0F);
  return x << 24 | (x & 0xFF00) << 8 | (x >> 8 & 0xFF00) | x >> 24;
}

// Direction numbers of the second and third dimension, of the primitive polynomials x + 1 and
// x^2 + x + 1 (the first dimension is the reversed bits of the index).
using SobolDirections = std::array<std::array<uint32_t, 32>, 2>;

constexpr SobolDirections sobol_directions() {
  SobolDirections v{};
  v[0][0] = v[1][0] = 1U << 31;
  v[1][1] = 3U << 30;
  for (size_t i = 1; i < 32; ++i) {
    v[0][i] = v[0][i - 1] ^ v[0][i - 1] >> 1;
    if (i >= 2) {
      v[1][i] = v[1][i - 1] ^ v[1][i - 2] ^ v[1][i - 2] >> 2;
    }
  }
  return v;
}

// A permutation of the leaves of the tree of leading bits: bits depend on higher ones only.
constexpr uint32_t owen_scrambled(uint32_t x, uint32_t seed) {
  x = reversed_bits(x);
  x ^= x * 0x3D20ADEA;
  x += seed;
  x *= (seed >> 16) | 1;
  x ^= x * 0x05526C56;
  x ^= x * 0x53A22864;
  return reversed_bits(x);
}

// Point `index` of the sequence that the three scrambles select; multiples of 2^-24 in [0, 1).
inline std::array<float, 3> low_discrepancy_point(uint32_t index,
                                                  const std::array<uint32_t, 3>& scrambles) {
  static constexpr SobolDirections kDirections = sobol_directions();
  std::array<uint32_t, 3> point{reversed_bits(index), 0, 0};
  for (size_t i = 0; index != 0; ++i, index >>= 1) {
    if (index & 1) {
      point[1] ^= kDirections[0][i];
      point[2] ^= kDirections[1][i];
    }
  }
  std::array<float, 3> result{};
  for (size_t i = 0; i < 3; ++i) {
    result[i] = static_cast<float>(owen_scrambled(point[i], scrambles[i]) >> 8) * 0x1p-24F;
  }
  return result;
}

}  // namespace itn::tracer
