// What lathes and potters' wheels make.
#include <cmath>
#include <utility>
#include <vector>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// A smooth curve through heights and radii (Catmull-Rom), from the bottom to the top.
Outline smooth_side(const Outline& through, int steps) {
  Outline side;
  const auto at = [&](size_t i) { return through[std::min(i, through.size() - 1)]; };
  for (size_t i = 0; i + 1 < through.size(); ++i) {
    const Vertex2 a = at(i == 0 ? 0 : i - 1), b = at(i), c = at(i + 1), d = at(i + 2);
    for (int s = 0; s < steps; ++s) {
      const float t = static_cast<float>(s) / static_cast<float>(steps);
      const auto blend = [t](float p, float q, float r, float u) {
        return q + 0.5F * t * (r - p + t * (2 * p - 5 * q + 4 * r - u + t * (3 * (q - r) + u - p)));
      };
      side.push_back({std::max(blend(a.x, b.x, c.x, d.x), 0.05F), blend(a.y, b.y, c.y, d.y)});
    }
  }
  side.push_back(through.back());
  return side;
}

// A side with the axis makes the outline of a solid body. Beyond the axis, so that none of it is an
// edge there.
Solid filled(const Outline& side) {
  Outline outline{{-0.5F, side.front().y}};
  outline.insert(outline.end(), side.begin(), side.end());
  outline.push_back({-0.5F, side.back().y});
  return revolved(outline);
}

Solid spindle(Dice& dice) {
  Outline through;
  const int points = dice.count(4, 7);
  const float half_height = dice.between(0.6F, 0.95F), stout = dice.scale(0.3F, 0.9F);
  for (int i = 0; i < points; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(points - 1);
    through.push_back({stout * dice.scale(0.25F, 1), half_height * (2 * t - 1)});
  }
  if (dice.chance(0.5)) return filled(smooth_side(through, 5));
  // Steps and cones instead.
  Outline side;
  for (const Vertex2 p : through) {
    if (!side.empty() && dice.chance(0.5)) side.push_back({p.x, side.back().y});
    side.push_back(p);
    if (side.size() > 1 && side[side.size() - 2].x == p.x && side[side.size() - 2].y == p.y) {
      side.pop_back();
    }
  }
  return filled(side);
}

Solid vessel(Dice& dice) {
  const int points = dice.count(3, 5);
  const float height = dice.between(0.8F, 1.8F), stout = dice.between(0.4F, 0.9F);
  Outline through;
  for (int i = 0; i < points; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(points - 1);
    through.push_back({stout * dice.scale(0.45F, 1), height * (t - 0.5F)});
  }
  const Outline side = smooth_side(through, 5);
  const float wall = dice.between(0.09F, 0.16F);
  Solid outside = filled(side);
  // The inside goes on beyond the brim.
  Outline above = side;
  above.push_back({side.back().x, height});
  const Solid inside = intersected(grown(filled(above), -wall),
                                   moved(box({2, 1, 2}), {0, 1 - height / 2 + 1.2F * wall, 0}));
  Solid solid = subtracted(std::move(outside), inside, dice.chance(0.5) ? 0.03F : 0);
  for (int handles = dice.chance(0.4) ? dice.count(1, 2) : 0; handles > 0; --handles) {
    const float ring = height * dice.between(0.2F, 0.3F);
    const float thick = dice.between(0.06F, 0.1F), out = through[points / 2].x;
    Solid handle = moved(turned(torus(ring, thick), {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}),
                         {out + 0.1F * ring, 0, 0});
    handle = subtracted(std::move(handle), grown(filled(side), -wall / 2));
    if (handles == 2) handle = turned(std::move(handle), Dice::about_y(kPi));
    solid = united(std::move(solid), std::move(handle), 0.05F);
  }
  return solid;
}

// A column with grooves or edges, straight or winding.
Solid column(Dice& dice) {
  const int flutes = dice.count(5, 14);
  const float radius = dice.between(0.3F, 0.7F), half_height = dice.between(0.5F, 0.95F);
  const float depth = radius * kPi / static_cast<float>(flutes) * dice.between(0.4F, 0.8F);
  const Solid groove =
      moved(cylinder(depth, 2), {radius + depth * dice.between(-0.2F, 0.5F), 0, 0});
  Solid solid = subtracted(cylinder(radius, half_height), repeated_around(groove, flutes));
  if (dice.chance(0.5)) solid = twisted(std::move(solid), dice.between(-1.6F, 1.6F));
  if (dice.chance(0.3)) solid = tapered(std::move(solid), dice.between(0, 0.35F));
  if (dice.chance(0.6)) {
    const float height = dice.between(0.06F, 0.14F), wide = radius * dice.between(1.1F, 1.5F);
    for (const float end : {-1.0F, 1.0F}) {
      const Solid cap = dice.chance(0.5) ? cylinder(wide, height) : box({wide, height, wide});
      solid = united(std::move(solid), moved(cap, {0, end * (half_height - height), 0}));
    }
  }
  return solid;
}

}  // namespace

Solid turned_solid(Dice& dice) {
  switch (dice.count(0, 4)) {
    case 0:
    case 1: return spindle(dice);
    case 2:
    case 3: return vessel(dice);
    default: return column(dice);
  }
}

}  // namespace itn::sdf
