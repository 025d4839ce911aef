#include "client/measured_media.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/error.h"

namespace itn {
namespace {

constexpr const char* kJensen = "Jensen et al. 2001";
constexpr const char* kNarasimhan = "Narasimhan et al. 2006";

}  // namespace

// Figures of the two papers, as tabulated there, in 1/mm.
const std::vector<MeasuredMedium>& measured_media() {
  // clang-format off
  static const std::vector<MeasuredMedium> media{
    {"apple", kJensen, {2.29, 2.39, 1.97}, {0.003, 0.0034, 0.046}, {0, 0, 0}, 1.3},
    {"chicken1", kJensen, {0.15, 0.21, 0.38}, {0.015, 0.077, 0.19}, {0, 0, 0}, 1.3},
    {"chicken2", kJensen, {0.19, 0.25, 0.32}, {0.018, 0.088, 0.2}, {0, 0, 0}, 1.3},
    {"cream", kJensen, {7.38, 5.47, 3.15}, {0.0002, 0.0028, 0.0163}, {0, 0, 0}, 1.3},
    {"ketchup", kJensen, {0.18, 0.07, 0.03}, {0.061, 0.97, 1.45}, {0, 0, 0}, 1.3},
    {"marble", kJensen, {2.19, 2.62, 3}, {0.0021, 0.0041, 0.0071}, {0, 0, 0}, 1.5},
    {"potato", kJensen, {0.68, 0.7, 0.55}, {0.0024, 0.009, 0.12}, {0, 0, 0}, 1.3},
    {"skimmilk", kJensen, {0.7, 1.22, 1.9}, {0.0014, 0.0025, 0.0142}, {0, 0, 0}, 1.3},
    {"skin1", kJensen, {0.74, 0.88, 1.01}, {0.032, 0.17, 0.48}, {0, 0, 0}, 1.3},
    {"skin2", kJensen, {1.09, 1.59, 1.79}, {0.013, 0.07, 0.145}, {0, 0, 0}, 1.3},
    {"spectralon", kJensen, {11.6, 20.4, 14.9}, {0, 0, 0}, {0, 0, 0}, 1.3},
    {"wholemilk", kJensen, {2.55, 3.21, 3.77}, {0.0011, 0.0024, 0.014}, {0, 0, 0}, 1.3},
    {"lowfat_milk", kNarasimhan, {13.116, 15.445, 17.957}, {0.002875, 0.00575, 0.0115}, {0.932, 0.902, 0.859}, 1.33},
    {"reduced_milk", kNarasimhan, {13.734, 15.6, 17.801}, {0.0025556, 0.0051111, 0.012778}, {0.819, 0.797, 0.746}, 1.33},
    {"regular_milk", kNarasimhan, {18.205, 20.383, 22.37}, {0.0015333, 0.0046, 0.019933}, {0.75, 0.714, 0.681}, 1.33},
    {"espresso", kNarasimhan, {7.7826, 8.1305, 8.5392}, {4.7984, 6.5751, 8.8493}, {0.907, 0.896, 0.88}, 1.33},
    {"mint_mocha_coffee", kNarasimhan, {3.5113, 4.1439, 5.5966}, {3.772, 5.8228, 7.82}, {0.91, 0.907, 0.914}, 1.33},
    {"lowfat_soy_milk", kNarasimhan, {2.0384, 2.3288, 3.9028}, {0.0014375, 0.0071875, 0.035937}, {0.85, 0.853, 0.842}, 1.33},
    {"regular_soy_milk", kNarasimhan, {4.6632, 5.2018, 8.7458}, {0.0019167, 0.0095833, 0.065167}, {0.873, 0.858, 0.832}, 1.33},
    {"lowfat_chocolate_milk", kNarasimhan, {9.8371, 11.495, 13.163}, {0.0115, 0.0368, 0.1564}, {0.934, 0.927, 0.916}, 1.33},
    {"regular_chocolate_milk", kNarasimhan, {10.569, 13.141, 15.22}, {0.010063, 0.043125, 0.14375}, {0.862, 0.838, 0.806}, 1.33},
    {"coke", kNarasimhan, {0.0025444, 0.00299, 0}, {0.10014, 0.16503, 0.2468}, {0.965, 0.972, 0}, 1.33},
    {"pepsi", kNarasimhan, {0.00083374, 0.0020269, 0}, {0.091641, 0.14158, 0.20729}, {0.926, 0.979, 0}, 1.33},
    {"sprite", kNarasimhan, {0.0001058, 0.00013647, 0.00013647}, {0.001886, 0.0018308, 0.0020025}, {0.943, 0.953, 0.952}, 1.33},
    {"gatorade", kNarasimhan, {0.036678, 0.044881, 0.057423}, {0.024794, 0.019289, 0.008878}, {0.933, 0.933, 0.935}, 1.33},
    {"chardonnay", kNarasimhan, {0.00020909, 0.00032757, 0.00048092}, {0.010782, 0.011855, 0.023997}, {0.914, 0.958, 0.975}, 1.33},
    {"white_zinfandel", kNarasimhan, {0.00021606, 0.00033454, 0.00046}, {0.012072, 0.016184, 0.019843}, {0.919, 0.943, 0.972}, 1.33},
    {"merlot", kNarasimhan, {0.00081265, 0, 0}, {0.11632, 0.25191, 0.29434}, {0.974, 0, 0}, 1.33},
    {"budweiser_beer", kNarasimhan, {0.00029345, 0.00054725, 0.00058689}, {0.011492, 0.024911, 0.057786}, {0.917, 0.956, 0.982}, 1.33},
    {"coors_light_beer", kNarasimhan, {0.000621, 0.001265, 0}, {0.006164, 0.013984, 0.034983}, {0.918, 0.966, 0}, 1.33},
    {"clorox", kNarasimhan, {0.027313, 0.033024, 0.036954}, {0.0033542, 0.014892, 0.026297}, {0.912, 0.905, 0.892}, 1.33},
    {"apple_juice", kNarasimhan, {0.0025683, 0.0031051, 0.0041273}, {0.012957, 0.023741, 0.052184}, {0.947, 0.949, 0.945}, 1.33},
    {"cranberry_juice", kNarasimhan, {0.0019626, 0.0023767, 0.0030053}, {0.039437, 0.094223, 0.12426}, {0.947, 0.951, 0.974}, 1.33},
    {"grape_juice", kNarasimhan, {0.00138, 0, 0}, {0.10404, 0.23958, 0.29325}, {0.961, 0, 0}, 1.33},
    {"ruby_grapefruit_juice", kNarasimhan, {0.15496, 0.1539, 0.15994}, {0.085867, 0.18314, 0.25262}, {0.929, 0.929, 0.931}, 1.33},
    {"white_grapefruit_juice", kNarasimhan, {0.505, 0.52743, 0.75283}, {0.0138, 0.018831, 0.056781}, {0.548, 0.545, 0.565}, 1.33},
    {"shampoo", kNarasimhan, {0.0079733, 0.00874, 0.01127}, {0.014107, 0.045693, 0.061717}, {0.91, 0.905, 0.92}, 1.33},
    {"strawberry_shampoo", kNarasimhan, {0.0021467, 0.0024534, 0.00253}, {0.01449, 0.05796, 0.075823}, {0.927, 0.935, 0.994}, 1.33},
    {"head_shoulders_shampoo", kNarasimhan, {0.26747, 0.27696, 0.29574}, {0.084621, 0.15688, 0.20365}, {0.911, 0.896, 0.884}, 1.33},
    {"lemon_tea_powder", kNarasimhan, {0.74489, 0.83822, 1.0016}, {2.4288, 4.5757, 7.2127}, {0.946, 0.946, 0.949}, 1.33},
    {"orange_powder", kNarasimhan, {0.001928, 0.002132, 0.002259}, {0.001449, 0.003441, 0.007863}, {0.919, 0.918, 0.922}, 1.33},
    {"pink_lemonade_powder", kNarasimhan, {0.001235, 0.001334, 0.001305}, {0.001165, 0.002366, 0.003195}, {0.902, 0.902, 0.904}, 1.33},
    {"cappuccino_powder", kNarasimhan, {12.209, 16.466, 29.273}, {35.844, 49.547, 61.084}, {0.849, 0.843, 0.926}, 1.33},
    {"salt_powder", kNarasimhan, {0.13805, 0.15677, 0.17865}, {0.28415, 0.3257, 0.34148}, {0.802, 0.793, 0.821}, 1.33},
    {"sugar_powder", kNarasimhan, {0.0028192, 0.0031498, 0.0039275}, {0.012638, 0.031051, 0.050124}, {0.921, 0.919, 0.931}, 1.33},
    {"suisse_mocha_powder", kNarasimhan, {30.085, 33.445, 38.719}, {17.502, 27.004, 35.433}, {0.907, 0.894, 0.888}, 1.33},
    {"pacific_ocean_surface_water", kNarasimhan, {0.0018, 0.001834, 0.002281}, {0.031845, 0.031324, 0.030147}, {0.902, 0.825, 0.914}, 1.33},
  };
  // clang-format on
  return media;
}

Material MeasuredMedium::material(size_t channel) const {
  const double sigma_t = sigma_s[channel] + sigma_a[channel];
  return {sigma_t, sigma_s[channel] / sigma_t, std::min(g[channel], kMaxAbsG)};
}

const MeasuredMedium& measured_medium(const std::string& name) {
  const auto& media = measured_media();
  const auto found = std::ranges::find_if(
      media, [&](const MeasuredMedium& medium) { return medium.name == name; });
  if (found != media.end()) return *found;
  throw invalid_input(fmt::format("{} is no measured medium; `itn materials` lists them", name));
}

}  // namespace itn
