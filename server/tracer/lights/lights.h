// All the light of a scene: a sum of lights, evaluated and sampled as one. For many
// directions at a time: lights-inl.h.
#pragma once

#include <array>
#include <cstddef>
#include <variant>
#include <vector>

#include "common/vec.h"
#include "server/tracer/lights/kinds.h"
#include "server/tracer/lights/light_frame.h"
#include "server/tracer/random/sampler.h"

namespace itn::tracer {

// A direction towards the light, drawn with density `pdf` per steradian. That of a delta cannot be
// hit by chance: its pdf is 0, and it needs no multiple importance sampling.
struct LightSample {
  Vec3f direction;
  float distance = 0;  // of the light or of a lamp that hides it, in mm, or infinite
  float weight = 0;    // radiance / pdf; of a delta, irradiance / probability of choosing it
  float pdf = 0;
  size_t number = 0;  // of the description of the light that was chosen
};

// The lights of a scene. Directions are unit vectors.
class Lights {
 public:
  // `colours`: of the first of them, on any scale; the others are white. Throws Error (invalid
  // input) if a number is out of range, a light has colours of its own, or nothing shines.
  Lights(const std::vector<LightDescription>& descriptions, const LightFrame& frame,
         const std::vector<Rgb>& colours = {});
  // On their own.
  Lights(const std::vector<LightDescription>& descriptions, Channel channel);

  // Places `from` are in mm, in the coordinates of the object; they matter where there are lamps.

  // The radiance of everything but deltas.
  float radiance(Vec3f direction, Vec3f from = {}) const;
  // The parts of radiance and of a sample's weight that are due to one description.
  float radiance_of(size_t number, Vec3f direction, Vec3f from = {}) const;
  float weight_of(size_t number, const LightSample& sample, Vec3f from = {}) const;
  // Density per steradian with which `sample` draws a direction.
  float pdf(Vec3f direction, Vec3f from = {}) const;
  // How far a line may go until a lamp ends it, in mm, or infinite.
  float reach(Vec3f from, Vec3f direction) const;
  // From the words of one counter, and of another one where there is a map.
  LightSample sample(Vec3f from, const RandomWords& words, const RandomWords& more) const;

  // Radiance integrated over all directions, plus the irradiances of deltas; in W/m^2.
  double power() const { return power_; }
  // Whether shadow rays end at lights, and whether other lines do.
  bool has_near() const { return has_near_; }
  bool has_lamps() const { return has_lamps_; }
  bool has_maps() const { return has_maps_; }

  // The panorama that a description was compiled to, or null.
  const EnvironmentMap* map_of(size_t number) const;

  // What is known of a description: its kind in LightDescription; whether it has a size; and how
  // its slots move its place or unit direction, in the coordinates of the object.
  struct Described {
    size_t kind;
    bool has_size;
    std::array<Vec3f, 3> axes;
  };
  const Described& described(size_t number) const { return described_[number]; }

  // The number of descriptions, those that do not shine too.
  size_t count() const { return described_.size(); }

  // Lights that shine, and lamps that hide what does, each drawn with its probability.
  struct Light {
    LightKind kind;
    float cumulative = 0;                     // of the probabilities, up to and including this one
    double probability = 0;                   // proportional to power
    size_t number = 0;                        // of its description; a sun and its sky have the same
    std::array<float, 3> colour = {1, 1, 1};  // of luminance 1
    uint32_t lamp = 0;  // its number among the lamps that lines meet, from 1 on; 0: it is none
    // The number of what sends light alone: that of a lamp, or that of a delta, behind all lamps;
    // 0: of what is far away and no delta, which is seen together.
    uint32_t source = 0;
  };
  const std::vector<Light>& all() const { return lights_; }

 private:
  std::vector<Described> described_;
  std::vector<Light> lights_;
  double power_ = 0;
  bool has_near_ = false, has_lamps_ = false, has_maps_ = false;
};

}  // namespace itn::tracer
