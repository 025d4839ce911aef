// Flat faces and sharp edges.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// Rings of planes about the y axis, as stones are cut.
Solid cut_stone(Dice& dice) {
  std::vector<Plane> planes;
  const int around = dice.count(4, 10);
  const auto ring = [&](float tilt, float offset, bool between) {
    for (int i = 0; i < around; ++i) {
      const float angle =
          2 * kPi * (static_cast<float>(i) + (between ? 0.5F : 0)) / static_cast<float>(around);
      planes.push_back(
          {{std::cos(tilt) * std::cos(angle), std::sin(tilt), std::cos(tilt) * std::sin(angle)},
           offset});
    }
  };
  const float girdle = dice.between(0.8F, 1);
  const float crown = dice.between(0.4F, 0.9F), pavilion = -dice.between(0.5F, 1);
  ring(0, girdle, false);
  ring(crown, girdle * dice.between(0.75F, 0.95F), dice.chance(0.5));
  ring(pavilion, girdle * dice.between(0.6F, 0.9F), dice.chance(0.5));
  if (dice.chance(0.5)) ring(dice.between(0.9F, 1.2F), girdle * 0.6F, true);
  planes.push_back({{0, 1, 0}, dice.between(0.3F, 0.6F)});
  planes.push_back({{0, -1, 0}, dice.between(0.5F, 1.1F)});
  return polyhedron(std::move(planes));
}

// A column with a point.
Solid crystal(Dice& dice, float radius, float length) {
  std::vector<Plane> planes;
  const int sides = dice.count(4, 7);
  const float steep = dice.between(0.4F, 0.9F);
  for (int i = 0; i < sides; ++i) {
    const float angle = 2 * kPi * static_cast<float>(i) / static_cast<float>(sides);
    const Vec3f out{std::cos(angle), 0, std::sin(angle)};
    planes.push_back({out, radius * dice.between(0.8F, 1)});
    const Vec3f tip = out * std::cos(steep) + Vec3f{0, std::sin(steep), 0};
    planes.push_back({tip, length * std::sin(steep) * dice.between(0.92F, 1)});
  }
  planes.push_back({{0, -1, 0}, 0.2F * length});
  return polyhedron(std::move(planes));
}

Solid crystals(Dice& dice) {
  Solid solid = scaled(gem(dice, 16), dice.between(0.3F, 0.5F));
  for (int n = dice.count(3, 7); n > 0; --n) {
    const Vec3f d = dice.direction();
    const Vec3f up = normalize(Vec3f{d.x, std::abs(d.y) + dice.between(0, 0.8F), d.z});
    solid = united(std::move(solid),
                   turned(crystal(dice, dice.between(0.12F, 0.26F), dice.between(0.6F, 1.2F)),
                          Dice::rotation_from_y(up)));
  }
  return solid;
}

void add_once(std::vector<Plane>& planes, Plane plane) {
  const auto same = [&](const Plane& other) { return dot(other.normal, plane.normal) > 0.9999F; };
  if (std::ranges::none_of(planes, same)) planes.push_back(plane);
}

// In all eight octants.
void add_octants(std::vector<Plane>& planes, Vec3f n, float offset) {
  for (int signs = 0; signs < 8; ++signs) {
    add_once(planes, {{(signs & 1) != 0 ? -n.x : n.x, (signs & 2) != 0 ? -n.y : n.y,
                       (signs & 4) != 0 ? -n.z : n.z},
                      offset});
  }
}

// Planes at right angles to all images of a direction under the rotations of the tetrahedron and
// the mirrors of the axes, which the icosahedron has too.
void add_icosahedral(std::vector<Plane>& planes, Vec3f n, float offset) {
  n = normalize(n);
  for (const Vec3f o : {n, Vec3f{n.y, n.z, n.x}, Vec3f{n.z, n.x, n.y}}) {
    add_octants(planes, o, offset);
  }
}

// Under all symmetries of the cube.
void add_cubic(std::vector<Plane>& planes, Vec3f n, float offset) {
  add_icosahedral(planes, n, offset);
  add_icosahedral(planes, {n.y, n.x, n.z}, offset);
}

// A polyhedron of cubic or icosahedral symmetry, its corners or edges cut.
Solid regular_body(Dice& dice) {
  std::vector<Plane> planes;
  const float golden = (1 + std::sqrt(5.0F)) / 2;
  if (dice.chance(0.35)) {
    const int which = dice.count(0, 2);
    if (which != 1) add_icosahedral(planes, {0, 1, golden}, 0.9F);
    if (which != 0) {
      const float offset = which == 1 ? 0.9F : dice.between(0.88F, 1);
      add_icosahedral(planes, {1, 1, 1}, offset);
      add_icosahedral(planes, {0, 1 / golden, golden}, offset);
    }
  } else {
    switch (dice.count(0, 4)) {
      case 0:
        add_cubic(planes, {1, 0, 0}, 0.8F);
        add_cubic(planes, {1, 1, 1}, dice.between(0.85F, 1.3F));
        break;
      case 1: add_cubic(planes, {1, 1, 1}, 0.65F); break;
      case 2:
        add_cubic(planes, {1, 1, 0}, 0.8F);
        if (dice.chance(0.5)) add_cubic(planes, {1, 0, 0}, dice.between(0.8F, 1));
        break;
      case 3:
        add_cubic(planes, {1, 0, 0}, 0.8F);
        add_cubic(planes, {1, 1, 0}, dice.between(0.85F, 1.1F));
        break;
      default:  // a tetrahedron, or two
        for (const Vec3f n : {Vec3f{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}}) {
          planes.push_back({normalize(n), 0.4F});
        }
        if (dice.chance(0.5)) {
          std::vector<Plane> opposite = planes;
          for (Plane& plane : opposite) plane.normal = -plane.normal;
          return united(polyhedron(planes), polyhedron(opposite));
        }
        break;
    }
  }
  Solid solid = polyhedron(std::move(planes));
  if (dice.chance(0.4)) {
    solid = stretched(std::move(solid), {dice.between(0.5F, 1), 1, dice.between(0.5F, 1)});
  }
  return solid;
}

// Stars and pyramids.
Solid star_body(Dice& dice) {
  const int tips = dice.count(3, 9);
  const bool star = dice.chance(0.6);
  const Outline outline =
      star ? star_outline(tips, dice.between(0.4F, 0.7F), 0.95F) : regular_outline(tips, 0.9F);
  const float half_height = dice.scale(0.12F, 0.9F);
  Solid solid = extruded(outline, half_height);
  if (dice.chance(0.6)) {  // faces that slope to a point or an edge
    std::vector<Plane> planes;
    const int sides = star ? 2 * tips : tips;
    const float steep = dice.between(0.4F, 1.1F), top = dice.between(0.6F, 1.3F);
    for (int i = 0; i < sides; ++i) {
      const float angle = 2 * kPi * (static_cast<float>(i) + 0.5F) / static_cast<float>(sides);
      planes.push_back(
          {{std::cos(steep) * std::cos(angle), std::sin(steep), std::cos(steep) * std::sin(angle)},
           top * std::sin(steep) * std::max(half_height, 0.4F)});
    }
    solid = intersected(std::move(solid), polyhedron(std::move(planes)));
  }
  if (dice.chance(0.35)) solid = twisted(std::move(solid), dice.between(-1.4F, 1.4F));
  return solid;
}

// Boxes upon and beside each other.
Solid blocks(Dice& dice) {
  const bool upright = dice.chance(0.7);
  Solid solid = box({0.4F, 0.4F, 0.4F});
  for (int n = dice.count(3, 9); n > 0; --n) {
    const Vec3f half{dice.scale(0.1F, 0.5F), dice.scale(0.1F, 0.6F), dice.scale(0.1F, 0.5F)};
    Solid block = box(half);
    if (!upright) block = turned(std::move(block), dice.rotation());
    solid = united(std::move(solid), moved(std::move(block), dice.in_box({0.5F, 0.5F, 0.5F})));
  }
  return solid;
}

// Steps up to a top, round about.
Solid steps(Dice& dice) {
  const int count = dice.count(3, 6), corners = dice.one_of({4, 4, 6, 8});
  const float slope = dice.between(0.5F, 1), height = dice.between(0.5F, 1.6F);
  Solid solid = box({0.1F, height / 2, 0.1F});
  for (int i = 0; i < count; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(count);
    const float top = height * (t + 1 / static_cast<float>(count));
    solid = united(std::move(solid),
                   moved(extruded(regular_outline(corners, 1 - slope * t, kPi / 4), top / 2),
                         {0, top / 2 - height / 2, 0}));
  }
  return solid;
}

Solid rocks(Dice& dice) {
  Solid solid = gem(dice, dice.count(8, 24));
  if (dice.chance(0.5)) {
    solid = scaled(std::move(solid), 0.7F);
    for (int n = dice.count(1, 3); n > 0; --n) {
      Solid other = scaled(gem(dice, dice.count(6, 20)), dice.between(0.35F, 0.7F));
      other = moved(std::move(other), dice.direction() * 0.5F);
      solid = dice.chance(0.7) ? united(std::move(solid), std::move(other))
                               : subtracted(std::move(solid), std::move(other));
    }
  }
  return solid;
}

}  // namespace

Solid gem(Dice& dice, int count) {
  std::vector<Plane> planes;
  planes.reserve(static_cast<size_t>(count) + 6);
  const float irregular = dice.between(0, 0.35F);
  for (int i = 0; i < count; ++i) {
    planes.push_back({dice.direction(), 0.75F - irregular * dice.between(0, 1)});
  }
  // Never endless.
  for (const float side : {-1.0F, 1.0F}) {
    planes.push_back({{side, 0, 0}, dice.between(0.7F, 1)});
    planes.push_back({{0, side, 0}, dice.between(0.5F, 1)});
    planes.push_back({{0, 0, side}, dice.between(0.5F, 1)});
  }
  return polyhedron(std::move(planes));
}

Outline regular_outline(int corners, float radius, float turned_by) {
  Outline outline;
  for (int i = 0; i < corners; ++i) {
    const float angle = turned_by + 2 * kPi * static_cast<float>(i) / static_cast<float>(corners);
    outline.push_back({radius * std::cos(angle), radius * std::sin(angle)});
  }
  return outline;
}

Outline star_outline(int tips, float inner_radius, float outer_radius) {
  Outline outline = regular_outline(2 * tips, outer_radius);
  for (size_t i = 1; i < outline.size(); i += 2) {
    outline[i].x *= inner_radius / outer_radius;
    outline[i].y *= inner_radius / outer_radius;
  }
  return outline;
}

Solid faceted_solid(Dice& dice) {
  Solid solid = [&] {
    switch (dice.count(0, 8)) {
      case 0: return cut_stone(dice);
      case 1: return crystals(dice);
      case 2: return regular_body(dice);
      case 3:
      case 4: return star_body(dice);
      case 5:
      case 6: return blocks(dice);
      case 7: return steps(dice);
      default: return rocks(dice);
    }
  }();
  if (dice.chance(0.12)) solid = tapered(std::move(solid), dice.between(-0.35F, 0.35F));
  return solid;
}

}  // namespace itn::sdf
