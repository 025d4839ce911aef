// The figures of the Hosek-Wilkie sky model (see hosek_wilkie_figures.cpp for source and licence).
#pragma once

namespace itn::tracer {

// [channel R, G, B][ground albedo 0, 1][turbidity 1..10][Bezier control point 0..5]
// [coefficients A, B, C, D, E, F, G, H, I, and the radiance that scales them].
extern const float kHosekWilkieRgb[3][2][10][6][10];

}  // namespace itn::tracer
