// Chains of limbs about a skeleton: animals, figures, busts, things that grow.
#include <algorithm>
#include <utility>
#include <vector>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// Everything is kept above this thickness, which grids can see.
constexpr float kThinnest = 0.05F;

struct Skeleton {
  std::vector<Limb> limbs;

  void add(Vec3f from, Vec3f to, float from_radius, float to_radius) {
    limbs.push_back({from, to, std::max(from_radius, kThinnest), std::max(to_radius, kThinnest)});
  }

  // Segments one after the other, each turned a little by chance.
  Vec3f add_chain(Dice& dice, Vec3f from, Vec3f towards, float length_, float from_radius,
                  float to_radius, int segments, float turning) {
    Vec3f direction = normalize(towards);
    for (int i = 0; i < segments; ++i) {
      const auto radius = [&](int joint) {
        const float t = static_cast<float>(joint) / static_cast<float>(segments);
        return from_radius + (to_radius - from_radius) * t;
      };
      direction = normalize(direction + dice.direction() * turning);
      const Vec3f to = from + direction * (length_ / static_cast<float>(segments));
      add(from, to, radius(i), radius(i + 1));
      from = to;
    }
    return from;
  }
};

// A head of about the given radius that looks along x, with a muzzle, ears or horns.
void add_head(Dice& dice, Skeleton& body, Vec3f neck, float radius) {
  body.add(neck, neck + Vec3f{radius * dice.between(0.2F, 0.6F), 0.02F, 0}, radius,
           radius * dice.between(0.7F, 1));
  if (dice.chance(0.7)) {
    const float muzzle = radius * dice.between(0.8F, 2);
    body.add(neck, neck + Vec3f{muzzle, -radius * dice.between(0.1F, 0.6F), 0}, radius * 0.6F,
             radius * dice.between(0.25F, 0.55F));
  }
  if (dice.chance(0.7)) {  // ears or horns
    const float height = radius * dice.between(0.9F, 2.6F);
    const float backwards = dice.between(-0.8F, 0.4F), apart = dice.between(0.3F, 1);
    const float thick = radius * dice.between(0.2F, 0.4F);
    for (const float side : {-1.0F, 1.0F}) {
      const Vec3f root = neck + Vec3f{-0.1F * radius, 0.6F * radius, side * 0.5F * radius};
      const Vec3f tip = root + normalize(Vec3f{backwards, 1, side * apart}) * height;
      body.add(root, tip, thick, thick * 0.5F);
    }
  }
}

// Limbs that end in a foot or a hand; mirrored, or each for itself.
void add_pair(Dice& dice, Skeleton& body, Vec3f hip, Vec3f towards, float length_, float radius) {
  const bool alike = dice.chance(0.4);
  const uint64_t pose = dice.random().next();
  for (const float side : {-1.0F, 1.0F}) {
    SplitMix random(alike ? pose : dice.random().next());
    Dice own(random);
    Skeleton limb;
    const Vec3f end = limb.add_chain(own, hip, towards, length_, radius, radius * 0.55F, 3, 0.35F);
    limb.add(end, end + Vec3f{radius * 1.2F, 0, 0}, radius * 0.6F, radius * 0.5F);
    for (const Limb& l : limb.limbs) {
      const auto there = [side](Vec3f p) { return Vec3f{p.x, p.y, side * p.z}; };
      body.add(there(l.from), there(l.to), l.from_radius, l.to_radius);
    }
  }
}

Skeleton four_legged(Dice& dice) {
  Skeleton body;
  const float length_ = dice.between(0.7F, 1.2F), girth = dice.scale(0.18F, 0.45F);
  const float legs = dice.scale(0.35F, 0.9F), thick = girth * dice.between(0.3F, 0.5F);
  const float height = legs - 0.5F;
  const Vec3f rump{-length_ / 2, height, 0};
  const Vec3f chest{length_ / 2, height + dice.between(-0.1F, 0.2F), 0};
  const Vec3f belly = (rump + chest) * 0.5F + Vec3f{0, dice.between(-0.08F, 0.08F), 0};
  body.add(rump, belly, girth * dice.between(0.7F, 1), girth);
  body.add(belly, chest, girth, girth * dice.between(0.7F, 1.1F));
  const Vec3f neck = chest + Vec3f{dice.between(0.1F, 0.3F), dice.between(0, 0.5F), 0};
  body.add(chest, neck, girth * 0.7F, girth * 0.5F);
  add_head(dice, body, neck, girth * dice.between(0.5F, 0.95F));
  const float apart = girth * 0.55F;
  const Vec3f down{dice.between(-0.2F, 0.2F), -1, 0.1F};
  add_pair(dice, body, rump + Vec3f{0.05F, -0.3F * girth, apart}, down, legs, thick);
  add_pair(dice, body, chest + Vec3f{0, -0.3F * girth, apart}, down, legs, thick);
  if (dice.chance(0.8)) {
    body.add_chain(dice, rump, {-1, dice.between(-0.7F, 0.9F), 0}, dice.between(0.2F, 0.9F),
                   girth * 0.4F, 0.05F, 4, 0.4F);
  }
  return body;
}

Skeleton two_legged(Dice& dice) {
  Skeleton body;
  const float girth = dice.scale(0.17F, 0.4F), height = dice.between(0.35F, 0.6F);
  const Vec3f hips{0, -0.15F, 0};
  const Vec3f shoulders{dice.between(-0.12F, 0.12F), -0.15F + height, 0};
  body.add(hips, shoulders, girth * dice.between(0.8F, 1.3F), girth);
  const float broad = girth * dice.between(0.7F, 1.3F);
  body.add(shoulders - Vec3f{0, 0, broad}, shoulders + Vec3f{0, 0, broad}, girth * 0.5F,
           girth * 0.5F);
  const Vec3f neck = shoulders + Vec3f{0.03F, girth * dice.between(1, 1.6F), 0};
  body.add(shoulders, neck, girth * 0.45F, girth * 0.4F);
  add_head(dice, body, neck, girth * dice.between(0.6F, 1.1F));
  const float thick = girth * dice.between(0.35F, 0.55F);
  add_pair(dice, body, hips + Vec3f{0, -0.2F * girth, girth * 0.6F},
           {dice.between(-0.3F, 0.3F), -1, dice.between(0.05F, 0.4F)}, dice.between(0.5F, 0.85F),
           thick);
  add_pair(dice, body, shoulders + Vec3f{0, 0, broad},
           {dice.between(-0.3F, 0.8F), dice.between(-1, 0.6F), dice.between(0.2F, 1)},
           dice.between(0.45F, 0.8F), thick * 0.8F);
  if (dice.chance(0.4)) {
    body.add_chain(dice, hips, {-1, dice.between(-0.6F, 0.2F), 0}, dice.between(0.4F, 0.9F),
                   girth * 0.6F, 0.05F, 4, 0.3F);
  }
  return body;
}

// Sitting: a heap of round masses with a head on top.
Skeleton squat(Dice& dice) {
  Skeleton body;
  const float girth = dice.between(0.38F, 0.6F);
  const Vec3f seat{-0.15F, -0.4F, 0};
  const Vec3f breast = seat + Vec3f{dice.between(0.15F, 0.45F), dice.between(0.25F, 0.55F), 0};
  body.add(seat, breast, girth, girth * dice.between(0.55F, 0.8F));
  const Vec3f head = breast + Vec3f{dice.between(0, 0.25F), dice.between(0.3F, 0.5F), 0};
  body.add(breast, head, girth * 0.5F, girth * 0.4F);
  add_head(dice, body, head, girth * dice.between(0.5F, 0.75F));
  const float thigh = girth * dice.between(0.4F, 0.55F), apart = girth * dice.between(0.6F, 0.9F);
  const float foot = dice.between(0.25F, 0.5F);
  for (const float side : {-1.0F, 1.0F}) {
    const Vec3f knee = seat + Vec3f{0.25F, -0.05F, side * apart};
    body.add(seat + Vec3f{0, 0, side * 0.5F * apart}, knee, thigh, thigh * 0.8F);
    body.add({knee.x, -0.75F, knee.z}, {knee.x + foot, -0.75F, knee.z}, thigh * 0.45F,
             thigh * 0.4F);
    const Vec3f shoulder = breast + Vec3f{0.1F, -0.05F, side * 0.35F * girth};
    body.add(shoulder, {shoulder.x + 0.15F, -0.7F, shoulder.z}, girth * 0.28F, girth * 0.18F);
  }
  if (dice.chance(0.5)) {
    const Vec3f rear = seat + Vec3f{-girth, -0.1F, 0};
    body.add(rear, rear + Vec3f{-dice.between(0.02F, 0.4F), dice.between(-0.1F, 0.3F), 0},
             girth * 0.3F, girth * dice.between(0.1F, 0.25F));
  }
  return body;
}

// A face upon a neck upon shoulders.
Skeleton bust(Dice& dice) {
  Skeleton body;
  const float skull = dice.between(0.3F, 0.42F), neck = skull * dice.between(0.4F, 0.65F);
  const Vec3f middle{0, 0.35F, 0};
  const Vec3f chin = middle + Vec3f{skull * 0.35F, -skull * dice.between(0.7F, 1.1F), 0};
  body.add(middle, middle + Vec3f{-skull * 0.3F, 0.1F, 0}, skull, skull * 0.9F);
  body.add(middle + Vec3f{0.1F, 0, 0}, chin, skull * 0.75F, skull * dice.between(0.25F, 0.45F));
  const Vec3f brow = middle + Vec3f{skull * 0.95F, skull * 0.15F, 0};
  body.add(brow, brow + Vec3f{skull * 0.25F, -skull * 0.45F, 0}, 0.06F,
           skull * dice.between(0.12F, 0.25F));  // the nose
  for (const float side : {-1.0F, 1.0F}) {
    const Vec3f cheek = middle + Vec3f{skull * 0.55F, -skull * 0.3F, side * skull * 0.45F};
    body.add(cheek, cheek + Vec3f{0.03F, 0.03F, 0}, skull * 0.35F, skull * 0.3F);
    const Vec3f ear = middle + Vec3f{0, 0, side * skull * 0.95F};
    body.add(ear, ear + Vec3f{-0.03F, -skull * 0.35F, 0}, skull * 0.2F, skull * 0.12F);
  }
  const Vec3f pit{-0.05F, -0.45F, 0};
  body.add(middle + Vec3f{-0.05F, -0.1F, 0}, pit, neck, neck * 1.2F);
  const float broad = dice.between(0.15F, 0.55F), deep = dice.between(0.2F, 0.32F);
  body.add(pit + Vec3f{0, -0.15F, -broad}, pit + Vec3f{0, -0.15F, broad}, deep, deep);
  if (dice.chance(0.6)) {  // hair, a hat or a crown
    const float high = dice.between(0.1F, 0.6F);
    const Vec3f top = middle + Vec3f{-0.1F, skull * 0.6F, 0};
    body.add(top, top + Vec3f{-dice.between(0, 0.25F), high, 0}, skull * dice.between(0.6F, 0.95F),
             skull * dice.between(0.3F, 1.1F));
  }
  return body;
}

// Branches of branches.
void grow(Dice& dice, Skeleton& body, Vec3f from, Vec3f direction, float length_, float radius,
          int generations) {
  const Vec3f end = body.add_chain(dice, from, direction, length_, radius, radius * 0.75F, 2, 0.3F);
  if (generations == 0) return;
  for (int branches = dice.count(2, 3); branches > 0; --branches) {
    grow(dice, body, end, normalize(direction + dice.direction() * 0.9F),
         length_ * dice.between(0.6F, 0.85F), radius * dice.between(0.6F, 0.8F), generations - 1);
  }
}

Skeleton grown_thing(Dice& dice) {
  Skeleton body;
  if (dice.chance(0.5)) {  // a coral
    grow(dice, body, {0, -0.8F, 0}, {0, 1, 0}, dice.between(0.4F, 0.6F), dice.between(0.13F, 0.25F),
         2);
  } else {  // arms around a body
    const float size = dice.between(0.25F, 0.5F);
    body.add({0, 0, 0}, {0, dice.between(0.1F, 0.5F), 0}, size, size * dice.between(0.6F, 1));
    const float thick = size * dice.between(0.25F, 0.45F), flat = dice.between(0.2F, 1);
    for (int arms = dice.count(3, 8); arms > 0; --arms) {
      const Vec3f d = dice.direction();
      const Vec3f out = normalize(Vec3f{d.x, d.y * flat - 0.2F, d.z});
      body.add_chain(dice, out * (0.6F * size), out, dice.between(0.5F, 0.9F), thick, thick * 0.4F,
                     4, 0.4F);
    }
  }
  return body;
}

// The skeleton of a long body, with or without fins.
Skeleton swimmer(Dice& dice) {
  Skeleton body;
  const float girth = dice.scale(0.14F, 0.4F);
  const Vec3f head{0.7F, 0, 0};
  Vec3f joint = head;
  const int joints = dice.count(3, 6);
  float radius = girth * dice.between(0.6F, 1);
  for (int i = 0; i < joints; ++i) {
    const float t = static_cast<float>(i + 1) / static_cast<float>(joints);
    const float next = girth * (1 - 0.8F * t) * dice.between(0.8F, 1.1F);
    const Vec3f to = joint + Vec3f{-1.5F / static_cast<float>(joints), dice.between(-0.15F, 0.15F),
                                   dice.between(-0.2F, 0.2F)};
    body.add(joint, to, radius, next);
    joint = to;
    radius = next;
  }
  if (dice.chance(0.7)) add_head(dice, body, head, girth * dice.between(0.6F, 1));
  for (int fins = dice.count(1, 4); fins > 0; --fins) {
    const Vec3f root{dice.between(-0.5F, 0.5F), 0, 0};
    const Vec3f out = normalize(Vec3f{dice.between(-1, 0), dice.between(-1, 1), 1});
    const float length_ = dice.between(0.3F, 0.6F);
    for (const float side : {-1.0F, 1.0F}) {
      body.add(root, root + Vec3f{out.x, out.y, side * out.z} * length_, girth * 0.5F, 0.06F);
    }
  }
  return body;
}

}  // namespace

Solid creature(Dice& dice) {
  const int plan = dice.count(0, 13);
  const Skeleton body = plan < 4    ? four_legged(dice)
                        : plan < 7  ? two_legged(dice)
                        : plan < 9  ? squat(dice)
                        : plan < 11 ? bust(dice)
                        : plan < 13 ? grown_thing(dice)
                                    : swimmer(dice);
  Solid solid = limbs(body.limbs, dice.scale(0.03F, 0.15F));
  if (dice.chance(0.75)) {  // a skin, fur, scales
    const float wavelength = dice.scale(0.12F, 0.6F);
    const float height = wavelength * dice.scale(0.015F, 0.07F);
    Waves waves = random_waves(dice.random(), wavelength, height, dice.count(1, 3));
    solid = dice.chance(0.5) ? displaced(std::move(solid), std::move(waves))
                             : creased(std::move(solid), std::move(waves));
  }
  if (dice.chance(0.3)) solid = bent(std::move(solid), dice.between(-0.5F, 0.5F));
  if (dice.chance(0.2)) solid = twisted(std::move(solid), dice.between(-0.6F, 0.6F));
  if (dice.chance(0.15)) {  // on a base, as statues are
    const float side = dice.between(0.4F, 0.7F);
    const Solid base = dice.chance(0.5) ? box({side, 0.12F, side}) : cylinder(side, 0.12F);
    solid = united(std::move(solid), moved(base, {0, dice.between(-0.75F, -0.55F), 0}), 0.02F);
  }
  return solid;
}

}  // namespace itn::sdf
