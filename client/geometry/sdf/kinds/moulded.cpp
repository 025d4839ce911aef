// What is poured or pressed: letters, stamped bars and tablets, candles.
#include <array>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "client/geometry/sdf/kinds.h"

namespace itn::sdf {
namespace {

// Letters as pen strokes through points of a grid, which are named row by row from the upper left:
// abc, def, ghi, jkl, mno.
constexpr std::array<std::string_view, 20> kLetters{
    "mbo jl", "cbdjno", "camo gh", "cam gh",  "am co gi", "bn",        "am cgo",
    "amo",    "mahco",  "maoc",    "bdjnlfb", "mabfhg",   "mabfhg ho", "fbdhlnj",
    "ac bn",  "ajnlc",  "anc",     "ao cm",   "ahc hn",   "acmo"};

Vec3f grid_point(char name) {
  const int number = name - 'a';
  return {0.3F * static_cast<float>(number % 3 - 1), 0.25F * static_cast<float>(2 - number / 3), 0};
}

// Letters of the given height side by side in the plane z = 0, about the origin.
std::vector<Limb> random_writing(Dice& dice, int letters, float height, float pen_radius) {
  std::vector<Limb> pen;
  for (int i = 0; i < letters; ++i) {
    const std::string_view letter =
        kLetters[static_cast<size_t>(dice.count(0, kLetters.size() - 1))];
    const Vec3f middle{0.9F * (static_cast<float>(i) - 0.5F * static_cast<float>(letters - 1)), 0,
                       0};
    for (size_t k = 1; k < letter.size(); ++k) {
      if (letter[k - 1] == ' ' || letter[k] == ' ') continue;
      pen.push_back({(grid_point(letter[k - 1]) + middle) * height,
                     (grid_point(letter[k]) + middle) * height, pen_radius, pen_radius});
    }
  }
  return pen;
}

// Letters that stand, of one thickness; several have a bar under them.
Solid standing_letters(Dice& dice) {
  const int letters = dice.count(1, 3);
  const float height = 1.9F / (0.6F + 0.9F * static_cast<float>(letters - 1) + 0.4F);
  const float pen = height * dice.between(0.09F, 0.15F), half_depth = dice.between(0.12F, 0.35F);
  Solid solid = stretched(limbs(random_writing(dice, letters, height, pen), 0.01F),
                          {1, 1, half_depth / pen * 1.3F});
  solid = intersected(std::move(solid), box({2, 2, half_depth}), dice.chance(0.5) ? 0.03F : 0);
  if (letters > 1) {
    const float half_width = 0.45F * height * static_cast<float>(letters);
    solid =
        united(std::move(solid), moved(box({half_width, pen, half_depth}), {0, -0.5F * height, 0}));
  }
  return solid;
}

// A flat body with edges that are rounded as far as its half height.
Solid tablet(Dice& dice, float half_height) {
  const float edge = half_height * dice.between(0.2F, 0.9F), deep = dice.between(0.5F, 0.9F);
  const Solid sharp = [&] {
    const float within = 0.95F - edge, height = half_height - edge;
    switch (dice.count(0, 3)) {
      case 0: return stretched(cylinder(within, height), {1, 1, deep});
      case 1: return extruded(regular_outline(dice.count(5, 8), within), height);
      default: return box({within, height, deep - edge});
    }
  }();
  return grown(sharp, edge);
}

// As soap and chocolate are: writing, dots or a rim, raised or sunk.
Solid stamped_bar(Dice& dice) {
  const float half_height = dice.between(0.15F, 0.4F);
  Solid solid = tablet(dice, half_height);
  const float pen = dice.between(0.04F, 0.07F);
  Solid stamp = [&] {
    switch (dice.count(0, 3)) {
      case 0: return repeated_around(moved(ball(1.5F * pen), {0.4F, 0, 0}), dice.count(4, 9));
      case 1: return stretched(torus(0.42F, pen), {1, 1, dice.between(0.7F, 1)});
      default: {
        const int letters = dice.count(1, 3);
        return turned(limbs(random_writing(dice, letters, 0.75F, pen), 0.01F),
                      Rotation<float>{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}});
      }
    }
  }();
  stamp = moved(std::move(stamp), {0, half_height, 0});
  const float fillet = dice.between(0, 0.03F);
  solid = dice.chance(0.5) ? subtracted(std::move(solid), std::move(stamp), fillet)
                           : united(std::move(solid), std::move(stamp), fillet);
  return dice.chance(0.4)
             ? turned(std::move(solid), Rotation<float>{{1, 0, 0}, {0, 0, -1}, {0, 1, 0}})
             : solid;
}

// With a pool about its wick, and now and then with what ran down.
Solid candle(Dice& dice) {
  const float radius = dice.scale(0.25F, 0.8F), half_height = dice.between(0.4F, 0.95F);
  Solid solid = dice.chance(0.3) ? extruded(regular_outline(dice.count(4, 8), radius), half_height)
                                 : cylinder(radius, half_height);
  if (dice.chance(0.3)) solid = tapered(std::move(solid), dice.between(0.1F, 0.5F));
  const float pool = radius * dice.between(0.7F, 1.2F);
  solid =
      subtracted(std::move(solid),
                 moved(ball(pool), {0, half_height + pool * dice.between(0.3F, 0.7F), 0}), 0.04F);
  std::vector<Limb> runs{{{0, 0, 0}, {0.02F, half_height + 0.15F, 0}, 0.05F, 0.05F}};
  for (int drops = dice.chance(0.4) ? dice.count(1, 4) : 0; drops > 0; --drops) {
    const float angle = dice.between(0, 2 * kPi), low = half_height * dice.between(-0.8F, 0.5F);
    const Vec3f side{radius * std::cos(angle), 0, radius * std::sin(angle)};
    runs.push_back({side + Vec3f{0, half_height * 0.8F, 0}, side + Vec3f{0, low, 0}, 0.05F, 0.09F});
  }
  return united(std::move(solid), limbs(runs, 0.01F), 0.03F);
}

}  // namespace

Solid moulded_solid(Dice& dice) {
  switch (dice.count(0, 3)) {
    case 0: return standing_letters(dice);
    case 1: return candle(dice);
    default: return stamped_bar(dice);
  }
}

}  // namespace itn::sdf
