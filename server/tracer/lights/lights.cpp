#include "server/tracer/lights/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "common/error.h"
#include "server/tracer/lights/light_sources.h"
#include "server/tracer/lights/sky.h"

namespace itn::tracer {
namespace {

constexpr double kPi = std::numbers::pi;

void check(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", name, value, low, high));
  }
}

}  // namespace

Lights::Lights(const std::vector<LightDescription>& descriptions, Channel channel)
    : count_(descriptions.size()) {
  const auto add = [&](std::unique_ptr<LightSource> source) {
    const double power = source->power();
    if (power > 0) {
      choices_.push_back({.cumulative = 0, .probability = power, .source = std::move(source)});
    }
  };
  const auto add_sun_sky = [&](const SunSkyLight& light) {
    check("sun_sky.turbidity", light.turbidity, 1, 10);
    check("sun_sky.ground_albedo", light.ground_albedo, 0, 1);
    check("sun_sky.sun_elevation (radians)", light.sun_elevation, 0, kPi / 2 + 1e-6);
    check("sun_sky.sun_angular_radius (radians)", light.sun_angular_radius, 1.7e-3, kPi / 4 + 1e-6);
    check("sun_sky.sun_scale", light.sun_scale, 0, 1e6);
    check("sun_sky.sky_scale", light.sky_scale, 0, 1e6);
    const double cos_elevation = std::cos(light.sun_elevation);
    const Vec3d sun{std::sin(light.sun_azimuth) * cos_elevation, std::sin(light.sun_elevation),
                    -std::cos(light.sun_azimuth) * cos_elevation};
    add(std::make_unique<SkySource>(light, sun, channel));
    add(std::make_unique<ConeSource>(
        sun, light.sun_angular_radius,
        light.sun_scale * select(sun_irradiance(light.turbidity, light.sun_elevation), channel)));
  };
  const auto add_map = [&](const EnvironmentMapLight& light) {
    check("environment_map.scale", light.scale, 0, 1e6);
    if (light.width < 1 || light.height < 1 ||
        light.rgb.size() != 3 * static_cast<size_t>(light.width) * light.height) {
      throw invalid_input(fmt::format("environment map: {} x {} pixels do not go with {} numbers",
                                      light.width, light.height, light.rgb.size()));
    }
    add(std::make_unique<MapSource>(light, channel));
  };
  const auto add_beam = [&](const DirectionalBeam& light) {
    check("directional.irradiance", light.irradiance, 0, 1e9);
    if (!is_finite(light.direction) || !(length(light.direction) > 0)) {
      throw invalid_input("directional.direction must be finite and not zero");
    }
    if (light.irradiance > 0) {
      choices_.push_back({.cumulative = 0,
                          .probability = light.irradiance,
                          .source = nullptr,
                          .direction = static_cast<Vec3f>(itn::normalize(light.direction)),
                          .irradiance = light.irradiance});
    }
  };

  for (const LightDescription& description : descriptions) {
    if (const auto* sun_sky = std::get_if<SunSkyLight>(&description)) {
      add_sun_sky(*sun_sky);
    } else if (const auto* map = std::get_if<EnvironmentMapLight>(&description)) {
      add_map(*map);
    } else if (const auto* constant = std::get_if<ConstantEnvironment>(&description)) {
      check("constant.radiance", constant->radiance, 0, 1e9);
      add(std::make_unique<UniformSource>(constant->radiance));
    } else {
      add_beam(std::get<DirectionalBeam>(description));
    }
  }

  for (const Choice& choice : choices_) {
    power_ += choice.probability;
  }
  if (!(power_ > 0)) {
    throw invalid_input("nothing shines: a scene needs at least one light with radiance > 0");
  }
  double cumulative = 0;
  for (Choice& choice : choices_) {
    choice.probability /= power_;
    cumulative += choice.probability;
    choice.cumulative = cumulative;
  }
}

float Lights::radiance(Vec3f direction) const {
  double sum = 0;
  for (const Choice& choice : choices_) {
    if (choice.source) {
      sum += choice.source->radiance(direction);
    }
  }
  return static_cast<float>(sum);
}

float Lights::pdf(Vec3f direction) const {
  double sum = 0;
  for (const Choice& choice : choices_) {
    if (choice.source) {
      sum += choice.probability * choice.source->pdf(direction);
    }
  }
  return static_cast<float>(sum);
}

LightSample Lights::sample(double u, float u0, float u1) const {
  auto choice = choices_.begin();
  while (choice + 1 != choices_.end() && u >= choice->cumulative) {
    ++choice;
  }
  if (!choice->source) {
    return {choice->direction, static_cast<float>(choice->irradiance / choice->probability), 0};
  }
  // What is left of u, once the choice is made, is uniform again.
  const double below = choice->cumulative - choice->probability;
  const double rest = std::clamp((u - below) / choice->probability, 0.0, 1.0);
  const Vec3f direction = choice->source->sample(rest, u0, u1);
  const float density = pdf(direction);
  // A direction on the very rim of the sun may fall outside it by rounding.
  return {direction, density > 0 ? radiance(direction) / density : 0, density};
}

size_t Lights::memory() const {
  size_t sum = 0;
  for (const Choice& choice : choices_) {
    sum += sizeof(Choice) + (choice.source ? choice.source->memory() : 0);
  }
  return sum;
}

}  // namespace itn::tracer
