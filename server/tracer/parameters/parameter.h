// What a render may be differentiated with respect to, by name.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace itn::tracer {

struct Parameter {
  enum Kind : uint8_t {
    kSigmaT,  // of the medium, in 1/mm; so is the derivative's unit, radiance * mm
    kAlbedo,
    kPhase,        // a slot of the phase function: of Henyey and Greenstein's, g
    kBoundary,     // a slot of the boundary of the medium
    kReflectance,  // a slot of the reflectance of surfaces[index]
    // A factor on all that lights[index] sends out, which is 1 in every scene: the derivative is
    // the part of the radiance that comes from this light.
    kLightScale,
    kLightPlace,  // a slot of lights[index]: where it is, or in which direction
    // A factor on all light that the object's medium has scattered `index` times, which is 1: the
    // derivative is that part of the radiance.
    kScattered,
  } kind = kSigmaT;
  uint32_t index = 0;  // of the surface or light, or how often it was scattered; else 0
  uint32_t slot = 0;   // in slots_of<> the kinds of what the parameter is of; else 0

  bool operator==(const Parameter&) const = default;
  bool of_medium() const { return kind <= kPhase; }
};

// sigma_t, albedo and g: the coordinates that derivatives of a medium of Henyey and Greenstein are
// accumulated in; others follow by the chain rule.
const std::vector<Parameter>& medium_parameters();

// "sigma_t", "albedo", "g", "two_term.weight", "rough_dielectric.index",
// "surface[0].reflectance", "surface[0].checkerboard.even", "light[1].scale",
// "light[1].sphere.center.x", "scattered[0].scale".
std::string name_of(const Parameter& parameter);

// All names, with K for any number.
std::vector<std::string> parameter_names();

// Throws Error (invalid input), which says what names there are.
Parameter parameter_named(std::string_view name);

}  // namespace itn::tracer
