#include "server/render/light_builder.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <variant>

#include "common/angle.h"
#include "common/error.h"
#include "common/scene/field_check.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// Of a panorama, where a sun may be far above all else. Its fourth power is a float's.
constexpr double kMaxRadiance = 1e9;

void check_pixels(const std::string& field, const v1::Pixels& proto) {
  integer_in(field + ".width", proto.width(), 1, 16384);
  integer_in(field + ".height", proto.height(), 1, 8192);
  const uint64_t expected = uint64_t{3} * sizeof(float) * proto.width() * proto.height();
  if (proto.rgb().size() != expected) {
    throw invalid_input(fmt::format("{}.rgb has {} bytes; {} x {} pixels take {}", field,
                                    proto.rgb().size(), proto.width(), proto.height(), expected));
  }
}

// Reads the fields of a description from a message in which they have the same names.
class FieldReader {
 public:
  FieldReader(std::string path, const Message& message)
      : path_(std::move(path)), message_(message) {}

  void number(const char* name, double& value, double low, double high) const {
    if (const FieldDescriptor* field = find(name)) {
      value = in_closed(path(name), message_.GetReflection()->GetFloat(message_, field), low, high);
    }
  }
  void angle(const char* name, double& radians, double low = -kInfinity,
             double high = kInfinity) const {
    if (double degrees = NAN; number(name, degrees, low, high), !std::isnan(degrees)) {
      radians = degrees * kRadiansPerDegree;
    }
  }
  void direction(const char* name, Vec3d& value) const {
    value = normalize(non_zero(path(name), vec(name)));
  }
  void position(const char* name, Vec3d& value) const {
    value = check_position(path(name), to_vec(vec(name)));
  }
  void pixels(const char* name, tracer::EnvironmentMapLight& map) const {
    const auto& proto = static_cast<const v1::EnvironmentMap&>(message_);
    if (proto.has_path()) {
      throw invalid_input(
          fmt::format("{} is set; a worker opens no files: send the pixels", path("path")));
    }
    if (!proto.has_pixels()) throw missing(path_ + ": one of pixels and path");
    const std::string pixels = path(name);
    check_pixels(pixels, proto.pixels());
    map.width = static_cast<int>(proto.pixels().width());
    map.height = static_cast<int>(proto.pixels().height());
    map.rgb = array_of<float>(pixels + ".rgb", proto.pixels().rgb());
    for (size_t i = 0; i < map.rgb.size(); ++i) {
      if (!(map.scale * map.rgb[i] >= 0 && map.scale * map.rgb[i] <= kMaxRadiance)) {
        throw invalid_input(
            fmt::format("{}.rgb is {} at x = {}, y = {}; times the scale it must be in [0, {:g}]",
                        pixels, map.rgb[i], i / 3 % map.width, i / 3 / map.width, kMaxRadiance));
      }
    }
    map.digest = sha256(proto.pixels().rgb());
  }

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  std::string path(const char* name) const { return path_ + "." + name; }
  // Null if it is not set.
  const FieldDescriptor* find(const char* name) const {
    const FieldDescriptor* field = message_.GetDescriptor()->FindFieldByName(name);
    return message_.GetReflection()->HasField(message_, field) ? field : nullptr;
  }
  v1::Vec3 vec(const char* name) const {
    const FieldDescriptor* field = find(name);
    return field == nullptr ? v1::Vec3()
                            : static_cast<const v1::Vec3&>(
                                  message_.GetReflection()->GetMessage(message_, field));
  }

  const std::string path_;
  const Message& message_;
};

// The description that the field of `Light` is called by.
template <size_t number = 0>
tracer::LightDescription describe(const std::string& name) {
  using Description = std::variant_alternative_t<number, tracer::LightDescription>;
  if (name == Description::kName) return Description();
  if constexpr (number + 1 < std::variant_size_v<tracer::LightDescription>) {
    return describe<number + 1>(name);
  } else {
    throw std::logic_error("no light is called " + name);
  }
}

// "sun_sky, environment_map, constant and directional"
std::string names_of(const google::protobuf::OneofDescriptor& kinds) {
  std::string names;
  for (int i = 0; i < kinds.field_count(); ++i) {
    const bool last = i + 1 == kinds.field_count();
    names += (i == 0 ? "" : last ? " and " : ", ") + kinds.field(i)->name();
  }
  return names;
}

}  // namespace

tracer::LightDescription build_light(const std::string& field, const v1::Light& proto) {
  const auto& kinds = *proto.GetDescriptor()->FindOneofByName("kind");
  const FieldDescriptor* kind = proto.GetReflection()->GetOneofFieldDescriptor(proto, &kinds);
  if (kind == nullptr) throw missing(field + ": one of " + names_of(kinds));
  const FieldReader reader(field + "." + kind->name(),
                           proto.GetReflection()->GetMessage(proto, kind));
  tracer::LightDescription light = describe(kind->name());
  std::visit([&]<typename Kind>(Kind& description) { Kind::fields(description, reader); }, light);
  return light;
}

}  // namespace itn
