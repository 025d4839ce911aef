#include "server/exports/panorama.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "common/angle.h"
#include "common/part_cache.h"
#include "server/tracer/lights/lights.h"

namespace itn {
namespace {

// The largest that is made, in pixels.
constexpr int kMostColumns = 4096, kFewestColumns = 512;

// In columns; 0: there is none.
int widest_map(const std::vector<tracer::LightDescription>& lights) {
  int widest = 0;
  for (const tracer::LightDescription& light : lights) {
    const auto* map = std::get_if<tracer::EnvironmentMapLight>(&light);
    if (map != nullptr) widest = std::max(widest, map->width);
  }
  return widest;
}

// So many that three pixels lie on the radius of the smallest sun.
int columns_for(const std::vector<tracer::LightDescription>& lights) {
  double columns = std::max(kFewestColumns, widest_map(lights));
  for (const tracer::LightDescription& light : lights) {
    double radius = 0;
    if (const auto* sky = std::get_if<tracer::SunSkyLight>(&light); sky && sky->sun_scale > 0) {
      radius = sky->sun_angular_radius;
    }
    if (const auto* sun = std::get_if<tracer::DirectionalLight>(&light)) {
      radius = sun->angular_radius;
    }
    if (radius > 0) columns = std::max(columns, 3 * 2 * std::numbers::pi / radius);
  }
  return std::min(kMostColumns, 2 * static_cast<int>(std::ceil(columns / 2)));
}

// The direction of a place in a panorama, in parts of its width and height.
Vec3f direction_of(double u, double v) {
  return static_cast<Vec3f>(direction_at(360 * u, 90 - 180 * v));
}

// Mitsuba's panoramas have their first row at v = 0 and their last one at v = 1.
int rows_for(int columns) {
  return columns / 2 + 1;
}

// The means of its pixels: by their middles, or by so many places on a side as each has pixels of a
// map, or by many where middle and corners differ.
std::vector<float> rendered_panorama(const tracer::Lights& lights, int columns, int pixels_of_map) {
  const int rows = rows_for(columns);
  const auto v_of = [&](double y) { return std::clamp((y - 0.5) / (rows - 1), 0.0, 1.0); };
  const auto radiance = [&](double x, double y) {
    return lights.radiance(direction_of(x / columns, v_of(y)));
  };
  const auto corners_of = [&](int row) {
    std::vector<float> corners;
    for (int x = 0; x <= columns; ++x) corners.push_back(radiance(x, row));
    return corners;
  };
  std::vector<float> result;
  std::vector<float> above = corners_of(0);
  for (int row = 0; row < rows; ++row) {
    const std::vector<float> below = corners_of(row + 1);
    for (int x = 0; x < columns; ++x) {
      const float middle = radiance(x + 0.5, row + 0.5);
      const auto [least, most] =
          std::ranges::minmax({above[x], above[x + 1], below[x], below[x + 1], middle});
      constexpr int kMany = 16;
      const int places = std::max(most > 1.2F * least ? kMany : 1, pixels_of_map);
      if (places == 1) {
        result.push_back(middle);
        continue;
      }
      double sum = 0, weights = 0;
      for (int j = 0; j < places; ++j) {
        const double y = row + (j + 0.5) / places;
        const double weight = std::sin(std::numbers::pi * v_of(y));
        for (int i = 0; i < places; ++i) {
          sum += weight * radiance(x + (i + 0.5) / places, y);
          weights += weight;
        }
      }
      result.push_back(static_cast<float>(sum / weights));
    }
    above = below;
  }
  return result;
}

// The most rows of a map that has twice as many in a panorama.
constexpr int kMostRows = 4096;

}  // namespace

bool is_panoramic(const tracer::LightDescription& light) {
  const auto* sun = std::get_if<tracer::DirectionalLight>(&light);
  return std::holds_alternative<tracer::SunSkyLight>(light) ||
         std::holds_alternative<tracer::EnvironmentMapLight>(light) ||
         std::holds_alternative<tracer::ConstantLight>(light) ||
         (sun != nullptr && sun->angular_radius > 0);
}

Panorama panorama_of(const std::vector<tracer::LightDescription>& lights,
                     const std::vector<tracer::Rgb>& colours, tracer::Channel channel) {
  Panorama panorama{.width = columns_for(lights), .rgb = {}};
  panorama.height = rows_for(panorama.width);
  panorama.rgb.resize(3 * static_cast<size_t>(panorama.width) * panorama.height);
  const int widest = widest_map(lights);
  panorama.loses_detail = widest > panorama.width;
  const int pixels_of_map = std::max(1, (widest + panorama.width - 1) / panorama.width);
  const auto add = [&](tracer::Channel seen, size_t first, size_t count) {
    PartCache parts(0);
    std::vector<std::string> keys;
    const tracer::Lights seen_lights(lights, {seen, {}, {}, parts, keys}, colours);
    const std::vector<float> one = rendered_panorama(seen_lights, panorama.width, pixels_of_map);
    for (size_t i = 0; i < one.size(); ++i) {
      for (size_t c = first; c < first + count; ++c) panorama.rgb[3 * i + c] = one[i];
    }
  };
  if (channel == tracer::Channel::kRgb) {
    for (size_t c = 0; c < 3; ++c) add(tracer::kColours[c], c, 1);
  } else {
    add(channel, 0, 3);
  }
  return panorama;
}

Panorama panorama_of(const tracer::EnvironmentMapLight& map) {
  const int steps = map.height > kMostRows ? 1 : 2;
  Panorama panorama{.width = map.width, .height = steps * map.height + 1, .rgb = {}};
  for (int row = 0; row < panorama.height; ++row) {
    const int above = steps == 1 ? row - 1 : (row - 1) / 2, below = row / steps;
    const size_t numbers = 3 * static_cast<size_t>(map.width);
    const float* const first = map.rgb.data() + std::max(0, above) * numbers;
    const float* const second = map.rgb.data() + std::min(below, map.height - 1) * numbers;
    for (size_t i = 0; i < numbers; ++i) panorama.rgb.push_back((first[i] + second[i]) / 2);
  }
  return panorama;
}

}  // namespace itn
