// Round bodies that flow together.
#include <utility>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// A body of about the given radius.
Solid round_body(Dice& dice, float size) {
  switch (dice.count(0, 5)) {
    case 0:
      return stretched(ball(1), {size * dice.between(0.5F, 1.2F), size * dice.between(0.5F, 1.2F),
                                 size * dice.between(0.5F, 1.2F)});
    case 1: return torus(size * 0.8F, size * dice.between(0.2F, 0.45F));
    case 2: {
      const float rounding = size * dice.between(0.1F, 0.3F);
      const Vec3f half{size * dice.between(0.4F, 0.8F), size * dice.between(0.4F, 0.8F),
                       size * dice.between(0.4F, 0.8F)};
      return grown(box(half - Vec3f{rounding, rounding, rounding}), rounding);
    }
    case 3:
      return limbs({{{0, -0.8F * size, 0},
                     {0, 0.8F * size, 0},
                     size * dice.between(0.25F, 0.6F),
                     size * dice.between(0.2F, 0.5F)}},
                   0.1F);
    case 4: {
      const float rounding = size * dice.between(0.08F, 0.2F);
      return grown(cylinder(size * dice.between(0.5F, 0.8F) - rounding,
                            size * dice.between(0.25F, 0.8F) - rounding),
                   rounding);
    }
    default: return ball(size * dice.between(0.6F, 0.9F));
  }
}

Solid placed(Dice& dice, Solid solid, Vec3f at) {
  return moved(turned(std::move(solid), dice.rotation()), at);
}

}  // namespace

Solid smooth_solid(Dice& dice) {
  const int bodies = dice.count(1, 6);
  const float size = bodies == 1 ? 0.9F : dice.between(0.4F, 0.6F);
  const float fillet = dice.scale(0.04F, 0.4F);
  // A walk from body to body, held near the middle.
  Vec3f at = bodies == 1 ? Vec3f{} : dice.direction() * 0.3F;
  Solid solid = placed(dice, round_body(dice, size), at);
  for (int i = 1; i < bodies; ++i) {
    at = at * 0.7F + dice.direction() * (size * dice.between(0.6F, 1.1F));
    solid = united(std::move(solid), placed(dice, round_body(dice, size * dice.scale(0.5F, 1)), at),
                   fillet);
  }
  if (dice.chance(0.4)) {
    for (int dents = dice.count(1, 3); dents > 0; --dents) {
      const float dent = dice.between(0.2F, 0.5F);
      solid = subtracted(std::move(solid),
                         placed(dice, round_body(dice, dent), dice.direction() * 0.75F),
                         dice.scale(0.02F, 0.2F));
    }
  }
  if (dice.chance(0.2)) solid = mirrored(moved(std::move(solid), {dice.between(0, 0.3F), 0, 0}));
  switch (dice.count(0, 5)) {
    case 0: solid = twisted(std::move(solid), dice.between(-1.3F, 1.3F)); break;
    case 1: solid = bent(std::move(solid), dice.between(-0.8F, 0.8F)); break;
    case 2: solid = tapered(std::move(solid), dice.between(-0.4F, 0.4F)); break;
    default: break;
  }
  if (dice.chance(0.55)) {
    const float wavelength = dice.scale(0.4F, 1.6F);
    const float height = wavelength * dice.scale(0.008F, 0.05F);
    Waves waves = random_waves(dice.random(), wavelength, height, dice.count(1, 3));
    solid = dice.chance(0.7) ? displaced(std::move(solid), std::move(waves))
                             : creased(std::move(solid), std::move(waves));
  }
  return solid;
}

}  // namespace itn::sdf
