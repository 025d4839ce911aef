#include "client/refine/scene_unknown.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "common/error.h"
#include "common/fields.h"
#include "server/tracer/boundary/boundary.h"
#include "server/tracer/lights/kinds.h"
#include "server/tracer/parameters/parameter.h"
#include "server/tracer/surfaces/reflectance.h"

namespace itn {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// Where a slot stands in a scene.
struct Place {
  double by_default;
  LogitScale range;
  Message* message;
  const FieldDescriptor* field;
};

Error none_of(const std::string& name, const std::string& why) {
  return invalid_input(fmt::format("{} cannot be refined: {}", name, why));
}

// `of`: in words. Throws if there is nothing of that name.
Place place_in(Message& owner, const std::string& of, const Slot& slot, const std::string& name) {
  Message* message = &owner;
  std::string_view path = slot.name;
  for (size_t dot = path.find('.'); dot != std::string_view::npos; dot = path.find('.')) {
    const std::string kind(path.substr(0, dot));
    const FieldDescriptor* field = message->GetDescriptor()->FindFieldByName(kind);
    if (field == nullptr || !message->GetReflection()->HasField(*message, field))
      throw none_of(name, fmt::format("{} has no {}", of, kind));
    message = message->GetReflection()->MutableMessage(message, field);
    path.remove_prefix(dot + 1);
  }
  const FieldDescriptor* field = message->GetDescriptor()->FindFieldByName(std::string(path));
  if (field == nullptr) throw none_of(name, "scene files do not have it");
  return {slot.value, {slot.low, slot.high}, message, field};
}

double value_at(const Place& place) {
  const google::protobuf::Reflection& access = *place.message->GetReflection();
  return access.HasField(*place.message, place.field) ? access.GetFloat(*place.message, place.field)
                                                      : place.by_default;
}

// A coordinate of a vector: as far from where it is, on either side, as the vector is long.
Place with_range(Place place) {
  const auto& vector = static_cast<const v1::Vec3&>(*place.message);
  const double reach = std::hypot(vector.x(), vector.y(), vector.z());
  place.range = {value_at(place) - reach, value_at(place) + reach};
  return place;
}

// That of a list which a parameter is of.
template <typename Entry>
Entry& entry(google::protobuf::RepeatedPtrField<Entry>& list, const tracer::Parameter& parameter,
             const char* what) {
  if (parameter.index >= static_cast<uint32_t>(list.size()))
    throw none_of(name_of(parameter), fmt::format("the scene has {} {}", list.size(), what));
  return list[static_cast<int>(parameter.index)];
}

Place place_of(v1::Scene& scene, const std::string& name) {
  const tracer::Parameter parameter = tracer::parameter_named(name);
  switch (parameter.kind) {
    case tracer::Parameter::kBoundary:
      return place_in(*scene.mutable_object(), "scene.object",
                      slots_of<tracer::Boundary>()[parameter.slot], name);
    case tracer::Parameter::kReflectance: {
      v1::Surface& surface = entry(*scene.mutable_surfaces(), parameter, "surfaces");
      const std::string of = fmt::format("scene.surfaces[{}]", parameter.index);
      const Slot& slot = slots_of<tracer::Reflectance>()[parameter.slot];
      const bool is_pattern = slot.name.find('.') != std::string::npos;
      if (!is_pattern && surface.pattern_case() != v1::Surface::PATTERN_NOT_SET)
        throw none_of(name, of + " has a pattern instead");
      return place_in(surface, of, slot, name);
    }
    case tracer::Parameter::kLightPlace:
      return with_range(place_in(entry(*scene.mutable_lights(), parameter, "lights"),
                                 fmt::format("scene.lights[{}]", parameter.index),
                                 slots_of<tracer::LightDescription>()[parameter.slot], name));
    default:
      throw none_of(name,
                    "it is no number of the boundary, the surfaces or the places of lights in "
                    "a scene file");
  }
}

}  // namespace

std::vector<SceneUnknown> scene_unknowns(std::span<const std::string> names,
                                         std::span<v1::Scene> scenes) {
  std::vector<SceneUnknown> unknowns;
  for (const std::string& name : names) {
    if (std::ranges::count(names, name) > 1) throw none_of(name, "it is asked for twice");
    std::vector<double> starts;
    for (v1::Scene& scene : scenes) {
      const Place place = place_of(scene, name);
      starts.push_back(value_at(place));
      if (starts.back() != starts.front()) {
        throw none_of(name, fmt::format("it is {} in the first scene and {} in another; it must be "
                                        "the same in all",
                                        starts.front(), starts.back()));
      }
      if (starts.size() > 1) continue;
      unknowns.push_back({name, starts.front(), place.range});
    }
  }
  return unknowns;
}

void set_unknowns(std::span<const SceneUnknown> unknowns, std::span<const double> values,
                  v1::Scene& scene) {
  for (size_t i = 0; i < unknowns.size(); ++i) {
    const Place place = place_of(scene, unknowns[i].name);
    place.message->GetReflection()->SetFloat(place.message, place.field,
                                             static_cast<float>(values[i]));
  }
}

}  // namespace itn
