// The lights of a scene as plain tables, for many directions at a time.
#pragma once

#include <vector>

#include "server/tracer/lights/light_sources.h"
#include "server/tracer/lights/lights.h"

namespace itn::tracer {

struct LightTables {
  explicit LightTables(const Lights& lights);

  // What the draw of a light is: the first whose cumulative probability exceeds a uniform number.
  enum class Kind { kUniform, kCone, kSky, kMap, kBeam };
  struct Light {
    Kind kind;
    size_t index;  // among those of its kind
    float cumulative;
  };
  // Probabilities of choosing a light are multiplied into the densities.
  struct Cone {
    Basis<float> basis;
    float one_minus_cos, radiance, density;
  };
  struct Sky {
    const float* values;
    const AliasTable::Entry* entries;
    const float* probabilities;
    float probability;
  };
  struct Map {
    int width, height;
    float rotation01;
    const float* values;
    const AliasTable::Entry* entries;
    const float* probabilities;
    float probability;
    std::vector<float> edges;           // y at the edges of the rows, falling
    std::vector<float> inverse_angles;  // of a pixel, by row: 1 / solid angle
  };
  struct Beam {
    Vec3f direction;
    float weight;  // irradiance / probability
  };
  std::vector<Light> lights;
  float uniform_radiance = 0, uniform_density = 0;
  std::vector<Cone> cones;
  std::vector<Sky> skies;
  std::vector<Map> maps;
  std::vector<Beam> beams;
};

}  // namespace itn::tracer
