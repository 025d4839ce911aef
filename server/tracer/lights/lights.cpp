#include "server/tracer/simd/targets.h"
// After targets.h:
#include <hwy/highway.h>

#include "server/tracer/lights/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

#include "common/error.h"
#include "common/fields.h"
#include "server/tracer/lights/lights-inl.h"

namespace itn::tracer {
namespace {

// One lane, without any special instructions.
namespace lanes = HWY_NAMESPACE;
namespace hn = lanes::hn;

// The numbers that say how bright a light is: its own, or the scales of what has colours.
struct Brightness : OtherFields {
  double by;
  bool has_colours = true;

  explicit Brightness(double factor) : by(factor) {}
  template <typename Number>
  void number(std::string_view name, Number& value, double /*low*/, double /*high*/) {
    const bool is_own = name == "radiance" || name == "irradiance" || name == "intensity";
    if (!is_own && !name.ends_with("scale")) return;
    value *= by;
    if (is_own) has_colours = false;
  }
};

// Makes a light what a film's channel sees of it; returns its colour of luminance 1.
std::array<float, 3> set_colour(LightDescription& light, Rgb colour, Channel channel) {
  std::visit(
      [&](auto& kind) {
        const double all = luminance(colour);
        for (double& part : colour) part /= all;
        Brightness brightness(channel == Channel::kRgb ? 1 : select(colour, channel));
        kind.fields(kind, brightness);
        if (brightness.has_colours)
          throw invalid_input(fmt::format("color: {} has colours of its own", kind.kName));
      },
      light);
  return {static_cast<float>(colour[0]), static_cast<float>(colour[1]),
          static_cast<float>(colour[2])};
}

// The axes of the scene; of a direction of any length, what they do to that of unit length.
std::array<Vec3f, 3> axes_of(const LightDescription& description, const Pose& pose) {
  double by = 1;
  if (const auto* light = std::get_if<DirectionalLight>(&description)) {
    by /= length(light->direction);
  }
  const auto turned = [&](Vec3d axis) {
    return static_cast<Vec3f>(pose.rotation.inverse()(axis * by));
  };
  return {turned({1, 0, 0}), turned({0, 1, 0}), turned({0, 0, 1})};
}

}  // namespace

void brighten(LightDescription& light, double by) {
  Brightness brightness(by);
  std::visit([&](auto& kind) { kind.fields(kind, brightness); }, light);
}

Rotation<double> turned_back(double azimuth) {
  const double c = std::cos(azimuth), s = std::sin(azimuth);
  return {{c, 0, s}, {0, 1, 0}, {-s, 0, c}};
}

Lights::Lights(const std::vector<LightDescription>& descriptions, const LightFrame& frame,
               const std::vector<Rgb>& colours) {
  size_t number = 0;  // of the description
  std::array<float, 3> colour;
  const auto add = [&]<typename Kind>(Kind&& kind) {
    const double power = kind.power();
    if (power > 0 || VisibleLamp<Kind>) {
      lights_.push_back({std::forward<Kind>(kind), 0, power, number, colour});
    }
  };
  const auto compile = [&]<typename Description>(const Description& light) {
    std::apply([&](auto&&... kinds) { (add(std::move(kinds)), ...); },
               std::tuple(light.compile(frame)));
  };
  for (const LightDescription& description : descriptions) {
    try {
      check_fields("", description);
      described_.push_back(
          {description.index(), has_size(description), axes_of(description, frame.pose)});
      colour = {1, 1, 1};
      if (number < colours.size() && colours[number] != Rgb{1, 1, 1}) {
        LightDescription coloured = description;
        colour = set_colour(coloured, colours[number], frame.channel);
        std::visit(compile, coloured);
      } else {
        std::visit(compile, description);
      }
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("lights[{}].{}", number, error.what()));
    }
    ++number;
  }
  // Lamps come first among what sends light alone.
  uint32_t lamps = 0, deltas = static_cast<uint32_t>(lights_.size());
  for (Light& light : lights_) {
    power_ += light.probability;
    std::visit(
        [&]<typename Kind>(const Kind& /*kind*/) {
          has_near_ |= !Kind::kDistant;
          if constexpr (VisibleLamp<Kind>) light.source = light.lamp = ++lamps;
          if constexpr (Kind::kDelta) light.source = ++deltas;
        },
        light.kind);
    has_lamps_ = lamps > 0;
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

const EnvironmentMap* Lights::map_of(size_t number) const {
  for (const Light& light : lights_) {
    if (light.number == number) return std::get_if<EnvironmentMap>(&light.kind);
  }
  return nullptr;
}

float Lights::radiance(Vec3f direction, Vec3f from) const {
  return hn::GetLane(lanes::look(*this, lanes::set(from), lanes::set(direction)).emission.radiance);
}

float Lights::radiance_of(size_t number, Vec3f direction, Vec3f from) const {
  float sum = 0;
  lanes::look(*this, lanes::set(from), lanes::set(direction),
              [&](const Light& light, lanes::Floats radiance) {
                if (light.number == number) sum += hn::GetLane(radiance);
              });
  return sum;
}

float Lights::pdf(Vec3f direction, Vec3f from) const {
  return hn::GetLane(lanes::look(*this, lanes::set(from), lanes::set(direction)).emission.pdf);
}

float Lights::reach(Vec3f from, Vec3f direction) const {
  return hn::GetLane(lanes::reach(*this, lanes::set(from), lanes::set(direction)));
}

float Lights::weight_of(size_t number, const LightSample& sample, Vec3f from) const {
  const bool from_far = sample.pdf > 0 && std::isinf(sample.distance);
  if (from_far) return radiance_of(number, sample.direction, from) / sample.pdf;
  return sample.number == number ? sample.weight : 0;
}

LightSample Lights::sample(Vec3f from, const RandomWords& words, const RandomWords& more) const {
  const lanes::LightSamples draw = lanes::sample(
      *this, lanes::set(from), lanes::light_choice(lanes::set(words), lanes::set(more)));
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
