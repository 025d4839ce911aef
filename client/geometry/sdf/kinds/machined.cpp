// What mills, drills and presses make.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// L, T, U, I, Z or cross: a beam seen from its end.
Outline profile(Dice& dice) {
  const float w = dice.between(0.5F, 0.9F), h = dice.between(0.5F, 0.9F);
  const float t = dice.between(0.14F, 0.3F);
  switch (dice.count(0, 4)) {
    case 0:  // L
      return {{-w, -h},        {w, -h}, {w, -h + 2 * t}, {-w + 2 * t, -h + 2 * t},
              {-w + 2 * t, h}, {-w, h}};
    case 1:  // T
      return {{-t, -h}, {t, -h}, {t, h - 2 * t},  {w, h - 2 * t},
              {w, h},   {-w, h}, {-w, h - 2 * t}, {-t, h - 2 * t}};
    case 2:  // U
      return {{-w, -h},
              {w, -h},
              {w, h},
              {w - 1.6F * t, h},
              {w - 1.6F * t, -h + 2 * t},
              {-w + 1.6F * t, -h + 2 * t},
              {-w + 1.6F * t, h},
              {-w, h}};
    case 3:  // I
      return {{-w, -h},
              {w, -h},
              {w, -h + 1.5F * t},
              {t, -h + 1.5F * t},
              {t, h - 1.5F * t},
              {w, h - 1.5F * t},
              {w, h},
              {-w, h},
              {-w, h - 1.5F * t},
              {-t, h - 1.5F * t},
              {-t, -h + 1.5F * t},
              {-w, -h + 1.5F * t}};
    default:  // cross
      return {{-t, -h}, {t, -h}, {t, -t}, {w, -t}, {w, t},   {t, t},
              {t, h},   {-t, h}, {-t, t}, {-w, t}, {-w, -t}, {-t, -t}};
  }
}

Solid gear(Dice& dice) {
  const int teeth = dice.count(7, 18);
  const float root = dice.between(0.6F, 0.8F), height = dice.scale(0.12F, 0.5F);
  const float half_width = kPi * root / static_cast<float>(teeth) * dice.between(0.4F, 0.6F);
  const float narrowing = dice.between(0.4F, 0.9F);
  Solid tooth = extruded({{0, -half_width},
                          {root, -half_width},
                          {0.98F, -half_width * narrowing},
                          {0.98F, half_width * narrowing},
                          {root, half_width},
                          {0, half_width}},
                         height);
  Solid solid = united(cylinder(root, height), repeated_around(std::move(tooth), teeth));
  if (dice.chance(0.3)) solid = twisted(std::move(solid), dice.between(-1, 1));
  if (dice.chance(0.6)) {
    solid = united(std::move(solid),
                   cylinder(dice.between(0.25F, 0.45F), height * dice.between(1.2F, 2)));
  }
  if (dice.chance(0.5)) {  // spokes
    const float middle = (root + 0.3F) / 2;
    solid = subtracted(
        std::move(solid),
        repeated_around(moved(cylinder(root * 0.17F, 1), {middle, 0, 0}), dice.count(3, 7)));
  }
  return subtracted(std::move(solid), cylinder(dice.between(0.12F, 0.2F), 1.4F));
}

Solid flange(Dice& dice) {
  const float thick = dice.between(0.08F, 0.2F), pipe = dice.between(0.3F, 0.55F);
  const float length = dice.between(0.3F, 0.9F);
  Solid solid = united(cylinder(0.95F, thick), moved(cylinder(pipe, length), {0, length, 0}),
                       dice.chance(0.5) ? dice.between(0.02F, 0.2F) : 0);
  if (dice.chance(0.4)) {
    solid = united(std::move(solid), moved(cylinder(pipe + dice.between(0.05F, 0.3F), thick),
                                           {0, 2 * length - thick, 0}));
  }
  solid = subtracted(std::move(solid), cylinder(pipe - dice.between(0.1F, 0.2F), 3));
  return moved(
      subtracted(std::move(solid), repeated_around(moved(cylinder(dice.between(0.06F, 0.13F), 0.5F),
                                                         {(pipe + 0.95F) / 2, 0, 0}),
                                                   dice.count(3, 10))),
      {0, -length / 2, 0});
}

// A hexagonal nut or a bolt.
Solid bolt(Dice& dice) {
  const float head = dice.between(0.2F, 0.35F);
  Solid hexagon = intersected(extruded(regular_outline(6, 0.75F), head),
                              stretched(ball(1), {0.8F, head * 1.6F, 0.8F}));
  if (dice.chance(0.4)) return subtracted(std::move(hexagon), cylinder(0.42F, 1));
  const float shaft = dice.between(0.22F, 0.4F);
  Solid solid = united(moved(std::move(hexagon), {0, 0.7F, 0}),
                       moved(cylinder(shaft, 0.75F), {0, -0.05F, 0}));
  if (dice.chance(0.6)) {  // grooves
    const Solid groove = torus(shaft + 0.02F, 0.05F);
    const Solid grooves =
        turned(repeated_along(turned(groove, Dice::about_z(kPi / 2)), 0.16F, dice.count(2, 4)),
               Dice::about_z(kPi / 2));
    solid = subtracted(std::move(solid), moved(grooves, {0, -0.35F, 0}));
  }
  return solid;
}

Solid blank(Dice& dice) {
  switch (dice.count(0, 6)) {
    case 0:
    case 1:
      return box({dice.between(0.5F, 0.9F), dice.scale(0.12F, 0.7F), dice.between(0.4F, 0.9F)});
    case 2: return cylinder(dice.between(0.4F, 0.9F), dice.scale(0.12F, 0.9F));
    case 3:
    case 4: return extruded(profile(dice), dice.between(0.25F, 0.8F));
    case 5: return extruded(regular_outline(dice.count(3, 8), 0.9F), dice.scale(0.15F, 0.8F));
    default: {  // a plate with round corners
      const float rounding = dice.between(0.1F, 0.35F);
      return intersected(
          elongated(cylinder(rounding, 1), {0.9F - rounding, 0, dice.between(0.2F, 0.6F)}),
          box({1, dice.scale(0.1F, 0.3F), 1}));
    }
  }
}

// What is drilled, milled or set upon a blank, and where.
Solid worked(Dice& dice, Solid solid) {
  const float fillet = dice.chance(0.3) ? dice.between(0.02F, 0.08F) : 0;
  for (int operations = dice.count(1, 4); operations > 0; --operations) {
    const Rotation<float> axis = dice.axis();
    const auto along_axis = [&](Solid tool) { return turned(std::move(tool), axis); };
    const Vec3f place{dice.between(-0.5F, 0.5F), 0, dice.between(-0.5F, 0.5F)};
    switch (dice.count(0, 8)) {
      case 0:  // a hole, with or without a wider mouth
      case 1: {
        const float radius = dice.scale(0.08F, 0.35F);
        Solid hole = cylinder(radius, 2);
        if (dice.chance(0.4)) {
          hole = united(std::move(hole),
                        moved(cylinder(radius * 1.6F, 0.5F), {0, dice.between(0.6F, 1), 0}));
        }
        const Vec3f at = dice.chance(0.5) ? Vec3f{} : place;
        solid = subtracted(std::move(solid), along_axis(moved(std::move(hole), at)), fillet);
        break;
      }
      case 2: {  // a row of holes, or a grid
        const float spacing = dice.between(0.28F, 0.5F),
                    radius = spacing * dice.between(0.2F, 0.35F);
        Solid holes = repeated_along(cylinder(radius, 2), spacing, dice.count(1, 3));
        if (dice.chance(0.5)) {
          holes = turned(repeated_along(turned(std::move(holes), Dice::about_y(kPi / 2)), spacing,
                                        dice.count(1, 2)),
                         Dice::about_y(-kPi / 2));
        }
        solid = subtracted(std::move(solid), along_axis(std::move(holes)), fillet);
        break;
      }
      case 3: {  // a circle of holes
        const float radius = dice.between(0.06F, 0.14F);
        solid = subtracted(
            std::move(solid),
            along_axis(repeated_around(
                moved(cylinder(radius, 2), {dice.between(0.35F, 0.65F), 0, 0}), dice.count(3, 8))),
            fillet);
        break;
      }
      case 4: {  // a slot
        const float width = dice.between(0.08F, 0.25F);
        const Solid slot = dice.chance(0.5)
                               ? box({width, 2, dice.between(0.3F, 2)})
                               : elongated(cylinder(width, 2), {0, 0, dice.between(0.2F, 0.5F)});
        solid = subtracted(std::move(solid), along_axis(moved(slot, {place.x, 0, 0})), fillet);
        break;
      }
      case 5: {  // a pocket
        const Vec3f half{dice.between(0.2F, 0.5F), 0.5F, dice.between(0.2F, 0.5F)};
        solid = subtracted(
            std::move(solid),
            along_axis(moved(box(half), {place.x * 0.5F, dice.between(0.55F, 0.8F), 0})), fillet);
        break;
      }
      case 6: {  // a corner taken away
        const Vec3f corner{dice.one_of({-0.8F, 0.8F}), dice.one_of({-0.8F, 0.8F}),
                           dice.one_of({-0.8F, 0.8F})};
        solid = subtracted(std::move(solid),
                           moved(box({dice.between(0.2F, 0.7F), dice.between(0.2F, 0.7F),
                                      dice.between(0.2F, 0.9F)}),
                                 corner),
                           fillet);
        break;
      }
      default: {  // a boss, with or without a hole
        const float radius = dice.between(0.15F, 0.4F), height = dice.between(0.4F, 0.95F);
        const Vec3f middle{place.x * 0.8F, height / 2, place.z * 0.8F};
        const Solid boss =
            dice.chance(0.6) ? cylinder(radius, height / 2) : box({radius, height / 2, radius});
        solid = united(std::move(solid), along_axis(moved(boss, middle)), fillet);
        if (dice.chance(0.6)) {
          solid = subtracted(
              std::move(solid),
              along_axis(moved(cylinder(radius * 0.55F, 1), {middle.x, 0.8F, middle.z})), fillet);
        }
        break;
      }
    }
  }
  return solid;
}

}  // namespace

Solid machined_solid(Dice& dice) {
  Solid solid = [&] {
    switch (dice.count(0, 9)) {
      case 0: return gear(dice);
      case 1: return flange(dice);
      case 2: return bolt(dice);
      default: return worked(dice, blank(dice));
    }
  }();
  if (dice.chance(0.2)) {  // broken edges
    const float rounding = dice.between(0.015F, 0.05F);
    solid = grown(std::move(solid), rounding);
  }
  return solid;
}

}  // namespace itn::sdf
