// Solids of solids.
#pragma once

#include <vector>

#include "client/geometry/sdf/solid.h"
#include "client/geometry/sdf/waves.h"

namespace itn::sdf {

// --- Sets. Where the surfaces meet there is a fillet of about the given size; 0: a sharp edge. ---
Solid united(Solid a, Solid b, float fillet = 0);
Solid intersected(Solid a, Solid b, float fillet = 0);
Solid subtracted(Solid a, Solid b, float fillet = 0);  // a without b

// --- Offsets ---
Solid grown(Solid solid, float by);  // < 0: shrunk
// The layer of the given thickness below the surface.
Solid hollowed(Solid solid, float thickness);
// A bumpy surface.
Solid displaced(Solid solid, Waves waves);
// A creased one: displaced inwards by the waves' absolute value.
Solid creased(Solid solid, Waves waves);

// --- Places ---
Solid moved(Solid solid, Vec3f by);
Solid turned(Solid solid, const Rotation<float>& rotation);
Solid scaled(Solid solid, float by);
Solid stretched(Solid solid, Vec3f by);
// Cut through the middle and drawn apart by twice `by` along each axis.
Solid elongated(Solid solid, Vec3f by);

// --- Symmetries ---
Solid mirrored(Solid solid);  // what is at x > 0, on both sides
// What is about the x axis (x > 0), `count` times about the y axis, each the mirror image of itself
// and its neighbours.
Solid repeated_around(Solid solid, int count);
// 2 count + 1 times along x, at a distance of `spacing`; the solid must be its own mirror image.
Solid repeated_along(Solid solid, float spacing, int count);

// --- Warps ---
Solid twisted(Solid solid, float radians_per_unit);  // about the y axis
Solid bent(Solid solid, float radians_per_unit);     // the x axis, in the plane z = 0
// Thinner (taper > 0) towards the top: across the y axis by exp(-taper y).
Solid tapered(Solid solid, float taper);
// Each coordinate moved by waves of its own.
Solid wobbling(Solid solid, Waves x, Waves y, Waves z);

}  // namespace itn::sdf
