// All the light of a scene: a sum of distant lights, evaluated and sampled as one.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "common/vec.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

// A direction towards the light, drawn with density `pdf` per steradian. A direction of a
// DirectionalBeam cannot be hit by chance: its pdf is 0, and it needs no multiple importance
// sampling.
struct LightSample {
  Vec3f direction;
  float weight = 0;  // radiance / pdf; for a beam irradiance / probability of choosing it
  float pdf = 0;
};

// One light that shines from a range of directions. Directions are unit vectors.
class LightSource {
 public:
  virtual ~LightSource() = default;
  virtual double radiance(Vec3f direction) const = 0;
  virtual double pdf(Vec3f direction) const = 0;  // per steradian, of `sample`
  // From uniform numbers in [0, 1): u chooses among cells, of which there may be millions; u0 and
  // u1 a direction within.
  virtual Vec3f sample(double u, float u0, float u1) const = 0;
  virtual double power() const = 0;  // radiance integrated over all directions
  virtual size_t memory() const = 0;
};

// The lights of a scene.
class Lights {
 public:
  // Throws Error (invalid input) if a number is out of range or nothing shines.
  Lights(const std::vector<LightDescription>& descriptions, Channel channel);

  // Of everything but beams, from a unit direction.
  float radiance(Vec3f direction) const;
  // Density per steradian with which `sample` draws a unit direction.
  float pdf(Vec3f direction) const;
  // From uniform numbers in [0, 1), u of more than 40 bits.
  LightSample sample(double u, float u0, float u1) const;

  // Radiance integrated over all directions, plus the beams' irradiances; in W/m^2.
  double power() const { return power_; }
  size_t memory() const;

  // As many as there are descriptions, those that do not shine too.
  size_t count() const { return count_; }

  // The lights, each drawn with its probability.
  struct Choice {
    double cumulative;   // of the choice probabilities, up to and including this one
    double probability;  // proportional to power
    std::unique_ptr<LightSource> source = nullptr;  // null for a beam
    Vec3f direction{};                              // of a beam
    double irradiance = 0;
  };
  const std::vector<Choice>& choices() const { return choices_; }

 private:
  size_t count_;
  std::vector<Choice> choices_;
  double power_ = 0;
};

}  // namespace itn::tracer
