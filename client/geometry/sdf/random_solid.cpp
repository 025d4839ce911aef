#include "client/geometry/sdf/random_solid.h"

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {

Kind random_kind(SplitMix& random) {
  double left = random.uniform();
  for (const KindInfo& info : kKinds) {
    if ((left -= info.probability) < 0) return info.kind;
  }
  return kKinds.back().kind;
}

Solid random_solid(Kind kind, SplitMix& random) {
  Dice dice(random);
  switch (kind) {
    case Kind::kSmooth: return smooth_solid(dice);
    case Kind::kCreature: return creature(dice);
    case Kind::kFaceted: return faceted_solid(dice);
    case Kind::kMachined: return machined_solid(dice);
    case Kind::kTurned: return turned_solid(dice);
    case Kind::kThin: return thin_solid(dice);
    case Kind::kMixed: return mixed_solid(dice);
    case Kind::kMoulded: return moulded_solid(dice);
  }
  return ball(1);
}

}  // namespace itn::sdf
