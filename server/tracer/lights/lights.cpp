#include "server/tracer/simd/targets.h"
// After targets.h:
#include <hwy/highway.h>

#include "server/tracer/lights/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <utility>

#include "common/error.h"
#include "server/tracer/lights/lights-inl.h"

namespace itn::tracer {
namespace {

// One lane, of a processor of no kind in particular.
namespace lanes = HWY_NAMESPACE;
namespace hn = lanes::hn;

constexpr double kPi = std::numbers::pi;

void check(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", name, value, low, high));
  }
}

// About +y, so that what stood at `azimuth` comes to stand over -z.
Rotation<double> turned_back(double azimuth) {
  const double c = std::cos(azimuth), s = std::sin(azimuth);
  return {{c, 0, s}, {0, 1, 0}, {-s, 0, c}};
}

}  // namespace

class Lights::Builder {
 public:
  Builder(Lights& lights, Channel channel, const Rotation<double>& to_scene, PartCache& parts,
          std::vector<std::string>& part_keys)
      : lights_(lights),
        channel_(channel),
        to_scene_(to_scene),
        parts_(parts),
        part_keys_(part_keys) {}

  void operator()(const SunSkyLight& light) {
    check("sun_sky.turbidity", light.turbidity, 1, 10);
    check("sun_sky.ground_albedo", light.ground_albedo, 0, 1);
    check("sun_sky.sun_elevation (radians)", light.sun_elevation, 0, kPi / 2 + 1e-6);
    check("sun_sky.sun_angular_radius (radians)", light.sun_angular_radius, 1.7e-3, kPi / 4 + 1e-6);
    check("sun_sky.sun_scale", light.sun_scale, 0, 1e6);
    check("sun_sky.sky_scale", light.sky_scale, 0, 1e6);
    const auto table = parts_.get<SkyTable>(
        keep("sky", light.turbidity, light.ground_albedo, light.sun_elevation, channel_), {}, [&] {
          return std::make_shared<const SkyTable>(light.turbidity, light.ground_albedo,
                                                  light.sun_elevation, channel_);
        });
    add(SkyLight(table, turned_back(light.sun_azimuth).after(to_scene_), light.sky_scale));
    const double cos_elevation = std::cos(light.sun_elevation);
    const Vec3d sun{std::sin(light.sun_azimuth) * cos_elevation, std::sin(light.sun_elevation),
                    -std::cos(light.sun_azimuth) * cos_elevation};
    add(SunDisc(to_scene_.inverse()(sun), light.sun_angular_radius,
                light.sun_scale * table->sun_irradiance()));
  }

  void operator()(const EnvironmentMapLight& light) {
    check("environment_map.scale", light.scale, 0, 1e6);
    if (light.width < 1 || light.height < 1 ||
        light.rgb.size() != 3 * static_cast<size_t>(light.width) * light.height) {
      throw invalid_input(fmt::format("environment map: {} x {} pixels do not go with {} numbers",
                                      light.width, light.height, light.rgb.size()));
    }
    const auto build = [&] { return std::make_shared<const EnvironmentMapTable>(light, channel_); };
    const auto table =
        light.digest.empty()
            ? build()
            : parts_.get<EnvironmentMapTable>(
                  keep("map" + light.digest, light.width, light.height, light.scale, channel_), {},
                  build);
    // A panorama turned by r, counter-clockwise seen from above, shows at azimuth a what stood at
    // a + r: azimuth grows from -z towards +x.
    add(EnvironmentMap(table, turned_back(-light.rotate_y).after(to_scene_)));
    lights_.has_maps_ = true;
  }

  void operator()(const ConstantLight& light) {
    check("constant.radiance", light.radiance, 0, 1e9);
    add(light);
  }

  void operator()(const DirectionalLight& light) {
    check("directional.irradiance", light.irradiance, 0, 1e9);
    if (!is_finite(light.direction) || !(length(light.direction) > 0)) {
      throw invalid_input("directional.direction must be finite and not zero");
    }
    add(DirectionalLight{to_scene_.inverse()(itn::normalize(light.direction)), light.irradiance});
  }

  size_t number = 0;  // of the description

 private:
  template <typename Kind>
  void add(Kind kind) {
    if (const double power = kind.power(); power > 0) {
      lights_.lights_.push_back({std::move(kind), 0, power, number});
    }
  }

  template <typename... Numbers>
  const std::string& keep(const std::string& what, const Numbers&... numbers) {
    return part_keys_.emplace_back(part_key(what, numbers...));
  }

  Lights& lights_;
  const Channel channel_;
  const Rotation<double>& to_scene_;
  PartCache& parts_;
  std::vector<std::string>& part_keys_;
};

Lights::Lights(const std::vector<LightDescription>& descriptions, Channel channel,
               const Rotation<double>& to_scene, PartCache& parts,
               std::vector<std::string>& part_keys)
    : count_(descriptions.size()) {
  Builder builder(*this, channel, to_scene, parts, part_keys);
  for (const LightDescription& description : descriptions) {
    std::visit(builder, description);
    ++builder.number;
  }
  for (const Light& light : lights_) power_ += light.probability;
  if (!(power_ > 0)) {
    throw invalid_input("nothing shines: a scene needs at least one light with radiance > 0");
  }
  double cumulative = 0;
  for (Light& light : lights_) {
    light.probability /= power_;
    cumulative += light.probability;
    light.cumulative = static_cast<float>(cumulative);
  }
  lights_.back().cumulative = 2;  // above every uniform number
}

Lights::Lights(const std::vector<LightDescription>& descriptions, Channel channel) {
  PartCache parts(std::numeric_limits<size_t>::max());
  std::vector<std::string> part_keys;
  *this = Lights(descriptions, channel, {}, parts, part_keys);
}

float Lights::radiance(Vec3f direction) const {
  return hn::GetLane(lanes::emission(*this, lanes::set(direction)).radiance);
}

float Lights::radiance(Vec3f direction, size_t number) const {
  return hn::GetLane(lanes::radiance_of(*this, number, lanes::set(direction)));
}

float Lights::pdf(Vec3f direction) const {
  return hn::GetLane(lanes::emission(*this, lanes::set(direction)).pdf);
}

float Lights::weight(const LightSample& sample, size_t number) const {
  if (sample.pdf > 0) return radiance(sample.direction, number) / sample.pdf;
  return sample.number == number ? sample.weight : 0;
}

LightSample Lights::sample(const RandomWords& words, const RandomWords& more) const {
  const auto one_lane = [](const RandomWords& w) {
    return lanes::Words{lanes::set(w[0]), lanes::set(w[1]), lanes::set(w[2]), lanes::set(w[3])};
  };
  const lanes::LightSamples draw = lanes::sample(*this, one_lane(words), one_lane(more));
  const float choice = hn::GetLane(lanes::uniform(lanes::set(words[0])));
  const auto chosen =
      std::ranges::find_if(lights_, [&](const Light& light) { return choice < light.cumulative; });
  const float radiance = hn::GetLane(draw.radiance), pdf = hn::GetLane(draw.pdf);
  const Vec3f direction{hn::GetLane(draw.direction.x), hn::GetLane(draw.direction.y),
                        hn::GetLane(draw.direction.z)};
  return {direction, pdf > 0 ? radiance / pdf : radiance, pdf, chosen->number};
}

}  // namespace itn::tracer
