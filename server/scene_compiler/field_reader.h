// Reads what a scene consists of (common/fields.h) from messages that have fields of the same
// names.
#pragma once

#include <google/protobuf/message.h>

#include <cmath>
#include <limits>
#include <string>
#include <variant>

#include "common/angle.h"
#include "common/scene/field_check.h"
#include "server/tracer/lights/environment_map.h"
#include "server/tracer/surfaces/image_reflectance.h"

namespace itn {

// All throw Error as in common/scene/field_check.h. What is absent keeps its default.
class FieldReader {
 public:
  // `path`: of the message, as "scene.lights[0].point".
  FieldReader(std::string path, const google::protobuf::Message& message)
      : path_(std::move(path)), message_(message) {}

  template <typename Number>
  void number(const char* name, Number& value, double low, double high) const {
    if (const double read = number_of(name); !std::isnan(read)) {
      value = static_cast<Number>(in_closed(path(name), read, low, high));
    }
  }
  template <typename Number>
  void slot(const char* name, Number& value, double low, double high) const {
    number(name, value, low, high);
  }
  void flag(const char* name, bool& value) const;
  void angle(const char* name, double& radians,
             double low = -std::numeric_limits<double>::infinity(),
             double high = std::numeric_limits<double>::infinity()) const {
    double degrees = NAN;
    number(name, degrees, low, high);
    if (!std::isnan(degrees)) radians = degrees * kRadiansPerDegree;
  }
  // Required.
  void direction(const char* name, Vec3d& value) const;
  void position(const char* name, Vec3d& value) const;
  void moving_direction(const char* name, Vec3d& value) const;  // of the length that it has
  void moving_position(const char* name, Vec3d& value) const { position(name, value); }
  // A `path` instead is refused.
  void pixels(const char* name, tracer::EnvironmentMapLight& map) const;
  void pixels(const char* name, tracer::ImageReflectance& image) const;

 private:
  std::string path(const char* name) const { return path_ + "." + name; }
  // NaN where it is absent: numbers of requests are finite.
  double number_of(const char* name) const;
  // R, G and B of each; times `scale` in [0, most].
  std::vector<float> pixel_values(const std::string& field, const v1::Pixels& proto, double scale,
                                  double most) const;
  // The pixels of a message with an oneof of `pixels` and `path`.
  template <typename Message>
  const v1::Pixels& required_pixels() const;
  // Null where it is absent.
  const v1::Vec3* vec(const char* name) const;

  const std::string path_;
  const google::protobuf::Message& message_;
};

// The field of a oneof that is set, or null; and the names of all: "path and pixels".
const google::protobuf::FieldDescriptor* set_field(const google::protobuf::Message& message,
                                                   const std::string& oneof);
std::string names_of(const google::protobuf::Message& message, const std::string& oneof);

// The kind of the list from `number` on that has a name.
template <typename Variant, size_t number = 0>
Variant kind_named(const std::string& name) {
  if constexpr (number < std::variant_size_v<Variant>) {
    using Kind = std::variant_alternative_t<number, Variant>;
    return name == Kind::kName ? Variant(Kind()) : kind_named<Variant, number + 1>(name);
  }
  throw Error(ErrorKind::kInternal, name + " is no kind");
}

// The kind whose message is set in a oneof of the same names. `field`: the path of the message that
// has the oneof, one of whose fields is required.
template <typename Variant>
Variant read_kind(const std::string& field, const google::protobuf::Message& message,
                  const std::string& oneof) {
  const google::protobuf::FieldDescriptor* set = set_field(message, oneof);
  if (set == nullptr) throw missing(field + ": one of " + names_of(message, oneof));
  const FieldReader reader(field + "." + set->name(),
                           message.GetReflection()->GetMessage(message, set));
  Variant result = kind_named<Variant>(set->name());
  std::visit([&]<typename Kind>(Kind& kind) { Kind::fields(kind, reader); }, result);
  return result;
}

}  // namespace itn
