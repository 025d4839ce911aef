#include "server/tracer/simd/targets.h"
// After targets.h:
#include <hwy/highway.h>

#include "server/tracer/lights/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <utility>

#include "common/angle.h"
#include "common/error.h"
#include "server/tracer/lights/lights-inl.h"

namespace itn::tracer {
namespace {

// One lane, without any special instructions.
namespace lanes = HWY_NAMESPACE;
namespace hn = lanes::hn;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Of every field of a description: throws unless it is in its range.
struct FieldCheck {
  std::string light;

  void number(const char* name, double value, double low, double high) const {
    if (!(value >= low && value <= high)) {
      throw invalid_input(
          fmt::format("{}.{} is {}; it must be in [{}, {}]", light, name, value, low, high));
    }
  }
  void angle(const char* name, double radians, double low = -kInfinity,
             double high = kInfinity) const {
    // Back from radians, 90 degrees may be the next larger number.
    number(name, std::round(radians / kRadiansPerDegree * 1e9) / 1e9, low, high);
  }
  void direction(const char* name, Vec3d value) const {
    if (!is_finite(value) || !(length(value) > 0)) {
      throw invalid_input(fmt::format("{}.{} must be finite and not zero", light, name));
    }
  }
  void position(const char* name, Vec3d value) const {
    if (!is_finite(value)) throw invalid_input(fmt::format("{}.{} must be finite", light, name));
  }
  // Looked at when they are compiled.
  void pixels(const char* /*name*/, const EnvironmentMapLight& /*map*/) const {}
};

}  // namespace

Rotation<double> turned_back(double azimuth) {
  const double c = std::cos(azimuth), s = std::sin(azimuth);
  return {{c, 0, s}, {0, 1, 0}, {-s, 0, c}};
}

Lights::Lights(const std::vector<LightDescription>& descriptions, const LightFrame& frame)
    : count_(descriptions.size()) {
  size_t number = 0;  // of the description
  const auto add = [&]<typename Kind>(Kind&& kind) {
    const double power = kind.power();
    if (power > 0) lights_.push_back({std::forward<Kind>(kind), 0, power, number});
  };
  const auto compile = [&]<typename Description>(const Description& light) {
    const FieldCheck check{Description::kName};
    Description::fields(light, check);
    std::apply([&](auto&&... kinds) { (add(std::move(kinds)), ...); },
               std::tuple(light.compile(frame)));
  };
  for (const LightDescription& description : descriptions) {
    std::visit(compile, description);
    ++number;
  }
  for (const Light& light : lights_) {
    power_ += light.probability;
    std::visit(
        [&]<typename Kind>(const Kind& /*kind*/) {
          if constexpr (Kind::kDelta) has_near_ |= !Kind::kDistant;
        },
        light.kind);
    has_maps_ |= std::holds_alternative<EnvironmentMap>(light.kind);
  }
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
  *this = Lights(descriptions, {channel, {}, {}, parts, part_keys});
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

LightSample Lights::sample(Vec3f from, const RandomWords& words, const RandomWords& more) const {
  const auto one_lane = [](const RandomWords& w) {
    return lanes::Words{lanes::set(w[0]), lanes::set(w[1]), lanes::set(w[2]), lanes::set(w[3])};
  };
  const lanes::LightSamples draw =
      lanes::sample(*this, lanes::set(from), one_lane(words), one_lane(more));
  const float choice = hn::GetLane(lanes::uniform(lanes::set(words[0])));
  const auto chosen =
      std::ranges::find_if(lights_, [&](const Light& light) { return choice < light.cumulative; });
  const float radiance = hn::GetLane(draw.radiance), pdf = hn::GetLane(draw.pdf);
  const Vec3f direction{hn::GetLane(draw.direction.x), hn::GetLane(draw.direction.y),
                        hn::GetLane(draw.direction.z)};
  return {direction, hn::GetLane(draw.distance), pdf > 0 ? radiance / pdf : radiance, pdf,
          chosen->number};
}

}  // namespace itn::tracer
