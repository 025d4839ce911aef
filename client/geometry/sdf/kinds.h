// A function for each kind of random solid. Internal to random_solid.
#pragma once

#include "client/geometry/sdf/dice.h"
#include "client/geometry/sdf/operators.h"
#include "client/geometry/sdf/primitives.h"
#include "client/geometry/sdf/solid.h"

namespace itn::sdf {

Solid smooth_solid(Dice& dice);
Solid creature(Dice& dice);
Solid faceted_solid(Dice& dice);
Solid machined_solid(Dice& dice);
Solid turned_solid(Dice& dice);
Solid thin_solid(Dice& dice);
Solid mixed_solid(Dice& dice);
Solid moulded_solid(Dice& dice);

// --- What several kinds share ---

// A convex body with edges.
Solid gem(Dice& dice, int planes);
// Corners of a regular polygon.
Outline regular_outline(int corners, float radius, float turned_by = 0);
// Corners at alternating distances from the middle.
Outline star_outline(int tips, float inner_radius, float outer_radius);

}  // namespace itn::sdf
