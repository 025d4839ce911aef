// An endless family of solids of many kinds.
#pragma once

#include <array>
#include <string_view>

#include "client/geometry/sdf/solid.h"
#include "common/random.h"

namespace itn::sdf {

enum class Kind { kSmooth, kCreature, kFaceted, kMachined, kTurned, kThin, kMixed, kMoulded };

struct KindInfo {
  Kind kind;
  std::string_view name, description;
  double probability;
};

inline constexpr std::array<KindInfo, 8> kKinds{{
    {Kind::kSmooth, "smooth", "round bodies that flow together, bent, twisted, dented", 0.16},
    {Kind::kCreature, "creature", "bodies with limbs, heads, horns and tails; busts; corals", 0.22},
    {Kind::kFaceted, "faceted", "gems, crystals, rocks, polyhedra, stars, stacks of blocks", 0.17},
    {Kind::kMachined, "machined", "drilled, slotted and stepped blanks, gears, flanges", 0.21},
    {Kind::kTurned, "turned", "vases, bowls, bottles, mugs, chessmen, fluted columns", 0.07},
    {Kind::kThin, "thin", "shells, blades, spikes, rings, knots, frames, lattices", 0.10},
    {Kind::kMixed, "mixed", "two of these, one set upon the other or cut out of it", 0.02},
    {Kind::kMoulded, "moulded", "letters, stamped bars and tablets, candles", 0.05},
}};

// By the probabilities of kKinds.
Kind random_kind(SplitMix& random);

// Within kReach of the origin, its longest side about 2; upright along y. Now and then it is in
// pieces or next to nothing: whoever wants one whole solid has to look.
Solid random_solid(Kind kind, SplitMix& random);

}  // namespace itn::sdf
