// Thin walls, blades, spikes, wires.
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// A hollow body with one opening or several.
Solid shell(Dice& dice) {
  Solid body = [&] {
    switch (dice.count(0, 3)) {
      case 0: return gem(dice, dice.count(8, 24));
      case 1:
        return stretched(ball(1),
                         {dice.between(0.6F, 1), dice.between(0.6F, 1), dice.between(0.6F, 1)});
      case 2:
        return box({dice.between(0.5F, 0.9F), dice.between(0.4F, 0.9F), dice.between(0.5F, 0.9F)});
      default:
        return displaced(ball(0.85F), random_waves(dice.random(), dice.between(0.8F, 1.6F),
                                                   dice.between(0.02F, 0.06F), 2));
    }
  }();
  body = hollowed(std::move(body), dice.between(0.08F, 0.14F));
  if (dice.chance(0.5)) {  // cut off
    const Vec3f up = dice.chance(0.6) ? Vec3f{0, 1, 0} : dice.direction();
    return intersected(std::move(body), polyhedron({{up, dice.between(-0.1F, 0.5F)}}));
  }
  for (int openings = dice.count(1, 6); openings > 0; --openings) {
    const Vec3f at = dice.direction() * 0.8F;
    body = subtracted(std::move(body), moved(ball(dice.between(0.25F, 0.5F)), at));
  }
  return body;
}

// Blades about a hub, straight, leaning or swept.
Solid blades(Dice& dice) {
  const int count = dice.count(2, 9);
  const float thick = dice.between(0.045F, 0.08F), high = dice.between(0.12F, 0.5F);
  const float hub = dice.between(0.15F, 0.4F);
  Solid blade = moved(box({0.48F, high, thick}), {0.48F, 0, 0});
  Solid solid = repeated_around(std::move(blade), count);
  if (dice.chance(0.7)) solid = twisted(std::move(solid), dice.between(-1.6F, 1.6F));
  solid = united(std::move(solid), cylinder(hub, high * dice.between(0.8F, 1.4F)),
                 dice.chance(0.5) ? 0.1F : 0);
  if (dice.chance(0.3)) {  // between plates, or in a ring
    const float out = dice.between(0.7F, 0.95F);
    solid = united(std::move(solid), dice.chance(0.5)
                                         ? moved(cylinder(out, 0.06F), {0, -high, 0})
                                         : Solid(hollowed(cylinder(out, high * 0.6F), 0.1F)));
  }
  return solid;
}

Solid spikes(Dice& dice) {
  const float core = dice.between(0.3F, 0.65F), length_ = dice.between(0.25F, 0.55F);
  Solid solid = dice.chance(0.7) ? ball(core) : scaled(gem(dice, 20), core);
  std::vector<Limb> all;
  const int count = dice.count(8, 36);
  const float thick = core * dice.between(0.12F, 0.3F);
  const float turn = kPi * (3 - std::sqrt(5.0F));  // evenly over the ball, along a spiral
  for (int i = 0; i < count; ++i) {
    const float y = 1 - (2 * static_cast<float>(i) + 1) / static_cast<float>(count);
    const float across = std::sqrt(1 - y * y), angle = turn * static_cast<float>(i);
    const Vec3f out = normalize(Vec3f{across * std::cos(angle), y, across * std::sin(angle)} +
                                dice.direction() * 0.15F);
    all.push_back(
        {out * (core * 0.6F), out * (core + length_ * dice.between(0.6F, 1)), thick, 0.03F});
  }
  return united(std::move(solid), limbs(all, 0.01F), dice.between(0.02F, 0.12F));
}

// A wire along a closed curve.
Solid wire(const std::vector<Vec3f>& curve, float radius) {
  std::vector<Limb> pieces;
  for (size_t i = 0; i < curve.size(); ++i) {
    pieces.push_back({curve[i], curve[(i + 1) % curve.size()], radius, radius});
  }
  return limbs(pieces, 0.02F);
}

Solid knot(Dice& dice) {
  const auto [p, q] = dice.one_of<std::array<int, 2>>({{2, 3}, {2, 5}, {3, 2}, {3, 4}, {1, 3}});
  const float tube = dice.between(0.07F, 0.14F), reach = dice.between(0.25F, 0.4F);
  std::vector<Vec3f> curve;
  constexpr int kPieces = 64;
  for (int i = 0; i < kPieces; ++i) {
    const float t = 2 * kPi * static_cast<float>(i) / kPieces;
    const float r = 0.6F + reach * std::cos(static_cast<float>(q) * t);
    curve.push_back({r * std::cos(static_cast<float>(p) * t),
                     reach * 1.3F * std::sin(static_cast<float>(q) * t),
                     r * std::sin(static_cast<float>(p) * t)});
  }
  return wire(curve, tube);
}

Solid spring(Dice& dice) {
  const int pieces = 60;
  const float turns = dice.between(2, 4), radius = dice.between(0.35F, 0.65F);
  std::vector<Limb> wire_;
  Vec3f last;
  for (int i = 0; i <= pieces; ++i) {
    const float t = static_cast<float>(i) / pieces, angle = 2 * kPi * turns * t;
    const Vec3f at{radius * std::cos(angle), 1.8F * t - 0.9F, radius * std::sin(angle)};
    if (i > 0) wire_.push_back({last, at, 0.1F, 0.1F});
    last = at;
  }
  return limbs(wire_, 0.02F);
}

// The edges of a box or a pyramid, as wires or beams.
Solid frame(Dice& dice) {
  const float thick = dice.between(0.06F, 0.13F);
  if (dice.chance(0.5)) {  // of beams: a box with a window through each axis
    const Vec3f half{dice.between(0.5F, 0.9F), dice.between(0.5F, 0.9F), dice.between(0.5F, 0.9F)};
    const float t = 2 * thick;
    Solid solid = box(half);
    solid = subtracted(std::move(solid), box({half.x - t, half.y - t, 2}));
    solid = subtracted(std::move(solid), box({half.x - t, 2, half.z - t}));
    return subtracted(std::move(solid), box({2, half.y - t, half.z - t}));
  }
  const int corners = dice.count(3, 6);
  const bool prism = dice.chance(0.5);
  const float half_height = dice.between(0.4F, 0.8F);
  const Outline base = regular_outline(corners, 0.8F);
  std::vector<Limb> edges;
  const Vec3f tip{0, half_height, 0};
  for (size_t i = 0; i < base.size(); ++i) {
    const Vertex2 a = base[i], b = base[(i + 1) % base.size()];
    const Vec3f p{a.x, -half_height, a.y}, q{b.x, -half_height, b.y};
    edges.push_back({p, q, thick, thick});
    if (prism) {
      const Vec3f up{0, 2 * half_height, 0};
      edges.push_back({p, p + up, thick, thick});
      edges.push_back({p + up, q + up, thick, thick});
    } else {
      edges.push_back({p, tip, thick, thick});
    }
  }
  return limbs(edges, dice.between(0.01F, 0.1F));
}

Solid lattice(Dice& dice) {
  const float period = dice.between(0.8F, 1.4F);
  const Solid wall =
      moved(gyroid(period, dice.between(0.1F, 0.16F)), dice.in_box({period, period, period}));
  const Solid body = dice.chance(0.5) ? ball(0.9F) : box({0.75F, dice.between(0.4F, 0.75F), 0.75F});
  return intersected(body, wall);
}

// A sheet with holes or waves, bent.
Solid plate(Dice& dice) {
  Solid solid = box({0.95F, dice.between(0.06F, 0.1F), dice.between(0.4F, 0.9F)});
  if (dice.chance(0.4)) {
    const float spacing = dice.between(0.3F, 0.5F);
    solid = subtracted(std::move(solid),
                       repeated_along(cylinder(spacing * 0.3F, 1), spacing, dice.count(1, 2)));
  }
  if (dice.chance(0.5)) {
    const auto waves = [&] {
      return random_waves(dice.random(), dice.between(1, 2), dice.between(0.03F, 0.1F), 1);
    };
    solid = wobbling(std::move(solid), waves(), waves(), waves());
  }
  return bent(std::move(solid), dice.between(-1, 1));
}

}  // namespace

Solid thin_solid(Dice& dice) {
  switch (dice.count(0, 9)) {
    case 0:
    case 1: return shell(dice);
    case 2:
    case 3: return blades(dice);
    case 4: return spikes(dice);
    case 5: return knot(dice);
    case 6: return spring(dice);
    case 7: return frame(dice);
    case 8: return lattice(dice);
    default: return plate(dice);
  }
}

}  // namespace itn::sdf
