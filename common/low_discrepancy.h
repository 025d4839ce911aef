// Three numbers for every sample of a pixel that fill the cube more evenly than independent ones:
// Sobol's points, scrambled by Owen's nested permutations so that each is uniform by itself and
// estimates stay unbiased. Sobol, "On the distribution of points in a cube", 1967; Owen, "Randomly
// permuted (t,m,s)-nets and (t,s)-sequences", 1995. The permutations are done by hashing the
// reversed bits, as Laine and Karras ("Stratified sampling for stochastic transparency", EGSR 2011)
// and Burley ("Practical hash-based Owen scrambling", JCGT 2020) do; this hash and its constants
// are those of Vegdahl, "Building a better LK hash", 2021
// (https://psychopath.io/post/2021_01_30_building_a_better_lk_hash).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace itn {

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
    if (i >= 2) v[1][i] = v[1][i - 1] ^ v[1][i - 2] ^ v[1][i - 2] >> 2;
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

// Sobol's point `index`, in units of 2^-32.
constexpr std::array<uint32_t, 3> sobol_point(uint32_t index) {
  constexpr SobolDirections kDirections = sobol_directions();
  std::array<uint32_t, 3> point{reversed_bits(index), 0, 0};
  for (size_t i = 0; index != 0; ++i, index >>= 1) {
    const uint32_t if_set = 0U - (index & 1);
    point[1] ^= kDirections[0][i] & if_set;
    point[2] ^= kDirections[1][i] & if_set;
  }
  return point;
}

// A coordinate of a point of the sequence that a scramble selects: a multiple of 2^-24 in [0, 1).
constexpr float scrambled_coordinate(uint32_t coordinate, uint32_t scramble) {
  return static_cast<float>(static_cast<int32_t>(owen_scrambled(coordinate, scramble) >> 8)) *
         0x1p-24F;
}

}  // namespace itn
