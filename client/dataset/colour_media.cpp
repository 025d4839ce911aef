#include "client/dataset/colour_media.h"

#include <algorithm>
#include <vector>

#include "client/dataset/distribution.h"
#include "client/measured_media.h"
#include "common/random.h"

namespace itn {
namespace {

// Coefficients of a colour, in any unit.
struct Coefficients {
  double sigma_s = 0, sigma_a = 0;
};
using Colours = std::array<Coefficients, 3>;
constexpr size_t kGreen = 1;

// Branches of kColours.
enum : uint64_t { kKind, kMedium, kRed };

// sigma_s (1 - g) in the place of sigma_s, of measured media that scatter more than a tenth of what
// they take from light, in each colour: of others little is seen but their absorption.
std::vector<Colours> scattering_media() {
  constexpr double kLeastAlbedo = 0.1;
  std::vector<Colours> media;
  for (const MeasuredMedium& medium : measured_media()) {
    Colours colours;
    bool scatters = true;
    for (size_t c = 0; c < colours.size(); ++c) {
      colours[c] = {medium.sigma_s[c] * (1 - medium.g[c]), medium.sigma_a[c]};
      scatters &= colours[c].sigma_s > kLeastAlbedo * (colours[c].sigma_s + colours[c].sigma_a);
    }
    if (scatters) media.push_back(colours);
  }
  return media;
}

// As much of a measured medium as scatters like `green`, at its g.
Colours measured_like(const Material& green, const v1::ColourChoice& choice,
                      const Choices& choices) {
  static const std::vector<Colours> kMedia = scattering_media();
  const v1::Interval ratios = range_of(choice.scattering());
  const Colours& medium =
      kMedia.at(choices.in_turn(derive_seed(kColours, {kMedium}), kMedia.size()));
  const double amount = green.sigma_s_reduced() / medium[kGreen].sigma_s;
  Colours colours;
  for (size_t c = 0; c < colours.size(); ++c) {
    const double ratio = medium[c].sigma_s / medium[kGreen].sigma_s;
    colours[c] = {.sigma_s = green.sigma_s() * std::clamp(ratio, ratios.min(), ratios.max()),
                  .sigma_a = amount * medium[c].sigma_a};
  }
  colours[kGreen].sigma_s = green.sigma_s();
  return colours;
}

Colours drawn_around(const Material& green, const v1::ColourChoice& choice,
                     const Choices& choices) {
  Colours colours;
  colours.fill({green.sigma_s(), green.sigma_a()});
  uint64_t branch = kRed;
  for (const size_t c : {size_t{0}, size_t{2}}) {
    colours[c].sigma_s *= choices.draw(derive_seed(kColours, {branch++}), choice.scattering());
    colours[c].sigma_a *= choices.draw(derive_seed(kColours, {branch++}), choice.absorption());
  }
  return colours;
}

// What is drawn of green, once more.
Material drawn_alike(const Material& green, const v1::MaterialChoice& materials,
                     const Choices& choices, uint64_t branch) {
  const auto draw = [&](uint64_t offset, const v1::Distribution& distribution) {
    return choices.draw(derive_seed(kColours, {branch + offset}), distribution);
  };
  return medium_of(materials, draw(0, density_of(materials)), draw(1, materials.albedo()), green.g);
}

}  // namespace

const v1::Distribution& density_of(const v1::MaterialChoice& materials) {
  return materials.has_sigma_s_reduced() ? materials.sigma_s_reduced() : materials.sigma_t();
}

Material medium_of(const v1::MaterialChoice& materials, double density, double albedo, double g) {
  const double sigma_t = materials.has_sigma_s_reduced() ? density / (albedo * (1 - g)) : density;
  return {.sigma_t = sigma_t, .albedo = albedo, .g = g};
}

std::array<Material, 3> draw_colours(const v1::MaterialChoice& materials, const Material& green,
                                     const Choices& choices) {
  const v1::ColourChoice& choice = materials.colours();
  const v1::Interval albedos = range_of(materials.albedo());
  const double kind = choices.number(derive_seed(kColours, {kKind}));
  std::array<Material, 3> media;
  media.fill(green);
  if (kind < choice.gray()) return media;
  if (kind >= 1 - choice.independent()) {
    media[0] = drawn_alike(green, materials, choices, kRed);
    media[2] = drawn_alike(green, materials, choices, kRed + 2);
    return media;
  }
  const Colours colours = kind < choice.gray() + choice.measured()
                              ? measured_like(green, choice, choices)
                              : drawn_around(green, choice, choices);
  for (size_t c = 0; c < media.size(); ++c) {
    const auto [sigma_s, sigma_a] = colours[c];
    const double albedo = std::clamp(sigma_s / (sigma_s + sigma_a), albedos.min(), albedos.max());
    media[c] = {.sigma_t = sigma_s / albedo, .albedo = albedo, .g = green.g};
  }
  return media;
}

}  // namespace itn
