#include "client/geometry/sdf/waves.h"

#include <cmath>
#include <numbers>

namespace itn::sdf {

Waves random_waves(SplitMix& random, float wavelength, float amplitude, int octaves) {
  constexpr int kPerOctave = 5;
  constexpr double kTurn = 2 * std::numbers::pi;
  Waves waves;
  double squares = 0;
  for (int octave = 0; octave < octaves; ++octave) {
    for (int i = 0; i < kPerOctave; ++i) {
      const double z = 2 * random.uniform() - 1, angle = kTurn * random.uniform();
      const double across = std::sqrt(1 - z * z);
      // Different lengths within an octave, so that nothing repeats.
      const double length = wavelength * std::ldexp(0.8 + 0.4 * random.uniform(), -octave);
      const Vec3d k =
          Vec3d{across * std::cos(angle), across * std::sin(angle), z} * (kTurn / length);
      waves.push_back(
          {Vec3f(k), static_cast<float>(kTurn * random.uniform()), static_cast<float>(length)});
      squares += length * length / 2;
    }
  }
  const auto scale = static_cast<float>(amplitude / std::sqrt(squares));
  for (Wave& wave : waves) wave.amplitude *= scale;
  return waves;
}

float slope_bound(const Waves& waves) {
  float slope = 0;
  for (const Wave& wave : waves) slope += wave.amplitude * length(wave.k);
  return slope;
}

}  // namespace itn::sdf
