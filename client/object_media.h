// What the objects of a scene are of, where the scene says it.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "common/material.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// The number of red, green or blue by which a medium is taken. Luminance is mostly green.
size_t number_of_channel(v1::Film::Channel shown);

// A measured medium, where an object stands for a thing whose longest side is `size`, in mm; 0: its
// own. `field` names the object. Throws Error (invalid input) if there is no such medium.
Material material_of(const std::string& medium, double size, const std::string& field,
                     const v1::Object& object, v1::Film::Channel shown);

// By the `medium` or `material` of an object, which `field` names; nothing if there is neither.
// Throws Error (invalid input).
std::optional<Material> material_of(const std::string& field, const v1::Object& object,
                                    v1::Film::Channel shown);

// Replaces the `medium` of other objects by a `material`, which is what workers take, in the
// channel that the film shows. Throws as above.
void resolve_media(v1::Scene& scene);

}  // namespace itn
