// Smooth random fields: sums of plane waves. Unlike noise on a lattice they have a slope that is
// known, and no axes of their own.
#pragma once

#include <vector>

#include "common/random.h"
#include "common/vec.h"

namespace itn::sdf {

// sin(x) within 0.0011, in operations that vectorise and are the same everywhere; its slope is at
// most 1. For |x| < 10^6.
inline float fast_sin(float x) {
  const float turns = x * 0.15915494F + 0.5F;
  const auto whole = static_cast<float>(static_cast<int>(turns));
  const float t = turns - (whole > turns ? whole - 1 : whole) - 0.5F;
  const float parabola = 8 * t - 16 * t * (t < 0 ? -t : t);
  return 0.225F * (parabola * (parabola < 0 ? -parabola : parabola) - parabola) + parabola;
}

struct Wave {
  Vec3f k;  // radians per unit of length
  float phase = 0, amplitude = 0;
};
using Waves = std::vector<Wave>;

// Octaves of waves in random directions, the first of the given wavelength, each further one of
// half of it; amplitudes are proportional to wavelengths, and their root mean square is the given
// one.
Waves random_waves(SplitMix& random, float wavelength, float amplitude, int octaves);

inline float sum(const Waves& waves, Vec3f p) {
  float value = 0;
  for (const Wave& wave : waves) value += wave.amplitude * fast_sin(dot(wave.k, p) + wave.phase);
  return value;
}

// No slope of the sum is larger.
float slope_bound(const Waves& waves);

}  // namespace itn::sdf
