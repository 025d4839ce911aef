// Two kinds in one.
#include <utility>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

Solid simple_solid(Dice& dice) {
  switch (dice.count(0, 4)) {
    case 0: return smooth_solid(dice);
    case 1: return creature(dice);
    case 2: return faceted_solid(dice);
    case 3: return machined_solid(dice);
    default: return turned_solid(dice);
  }
}

}  // namespace

Solid mixed_solid(Dice& dice) {
  Solid first = simple_solid(dice), second = simple_solid(dice);
  const float fillet = dice.chance(0.5) ? dice.between(0.01F, 0.1F) : 0;
  switch (dice.count(0, 2)) {
    case 0:  // one on top of the other
      return united(moved(scaled(std::move(first), 0.65F), {0, 0.35F, 0}),
                    moved(scaled(std::move(second), 0.6F), {0, -0.4F, 0}), fillet);
    case 1: {  // a piece taken out
      const Vec3f at = dice.direction() * 0.6F;
      return subtracted(std::move(first), moved(scaled(std::move(second), 0.5F), at), fillet);
    }
    default: {  // grown into one another
      const Vec3f at = dice.direction() * dice.between(0.1F, 0.5F);
      second = turned(scaled(std::move(second), dice.between(0.4F, 0.8F)), dice.rotation());
      return united(scaled(std::move(first), 0.8F), moved(std::move(second), at), fillet);
    }
  }
}

}  // namespace itn::sdf
