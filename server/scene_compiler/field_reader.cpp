#include "server/scene_compiler/field_reader.h"

#include <fmt/format.h>

#include "common/error.h"
#include "common/scene/scene_bytes.h"
#include "server/tracer/lights/environment_map.h"

namespace itn {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

namespace {

void check_pixels(const std::string& field, const v1::Pixels& proto) {
  integer_in(field + ".width", proto.width(), 1, 16384);
  integer_in(field + ".height", proto.height(), 1, 8192);
  const uint64_t expected = uint64_t{3} * sizeof(float) * proto.width() * proto.height();
  if (proto.rgb().size() != expected) {
    throw invalid_input(fmt::format("{}.rgb has {} bytes; {} x {} pixels take {}", field,
                                    proto.rgb().size(), proto.width(), proto.height(), expected));
  }
}

// Null where it is absent.
const FieldDescriptor* present(const Message& message, const char* name) {
  const FieldDescriptor* field = message.GetDescriptor()->FindFieldByName(name);
  return message.GetReflection()->HasField(message, field) ? field : nullptr;
}

}  // namespace

double FieldReader::number_of(const char* name) const {
  const FieldDescriptor* field = present(message_, name);
  return field == nullptr ? NAN : double{message_.GetReflection()->GetFloat(message_, field)};
}

const v1::Vec3* FieldReader::vec(const char* name) const {
  const FieldDescriptor* field = present(message_, name);
  return field == nullptr
             ? nullptr
             : &static_cast<const v1::Vec3&>(message_.GetReflection()->GetMessage(message_, field));
}

void FieldReader::flag(const char* name, bool& value) const {
  const FieldDescriptor* field = present(message_, name);
  if (field != nullptr) value = message_.GetReflection()->GetBool(message_, field);
}

void FieldReader::direction(const char* name, Vec3d& value) const {
  moving_direction(name, value);
  value = normalize(value);
}

void FieldReader::moving_direction(const char* name, Vec3d& value) const {
  const v1::Vec3* read = vec(name);
  value = non_zero(path(name), read == nullptr ? v1::Vec3() : *read);
}

void FieldReader::position(const char* name, Vec3d& value) const {
  if (const v1::Vec3* read = vec(name)) value = check_position(path(name), to_vec(*read));
}

std::vector<float> FieldReader::pixel_values(const std::string& field, const v1::Pixels& proto,
                                             double scale, double most) const {
  check_pixels(field, proto);
  const int width = static_cast<int>(proto.width());
  std::vector<float> rgb = array_of<float>(field + ".rgb", proto.rgb());
  for (size_t i = 0; i < rgb.size(); ++i) {
    if (!(scale * rgb[i] >= 0 && scale * rgb[i] <= most)) {
      throw invalid_input(fmt::format("{}.rgb is {} at x = {}, y = {}; {}it must be in [0, {:g}]",
                                      field, rgb[i], i / 3 % width, i / 3 / width,
                                      scale == 1 ? "" : "times the scale ", most));
    }
  }
  return rgb;
}

template <typename Message>
const v1::Pixels& FieldReader::required_pixels() const {
  const auto& proto = static_cast<const Message&>(message_);
  if (proto.has_path()) {
    throw invalid_input(
        fmt::format("{} is set; a worker opens no files: send the pixels", path("path")));
  }
  if (!proto.has_pixels()) throw missing(path_ + ": one of pixels and path");
  return proto.pixels();
}

void FieldReader::pixels(const char* name, tracer::EnvironmentMapLight& map) const {
  const v1::Pixels& proto = required_pixels<v1::EnvironmentMap>();
  map.rgb = pixel_values(path(name), proto, map.scale, tracer::EnvironmentMapLight::kMaxRadiance);
  map.width = static_cast<int>(proto.width());
  map.height = static_cast<int>(proto.height());
  map.digest = sha256(proto.rgb());
}

void FieldReader::pixels(const char* name, tracer::ImageReflectance& image) const {
  const v1::Pixels& proto = required_pixels<v1::ImageReflectance>();
  image.values = std::make_shared<const std::vector<float>>(pixel_values(path(name), proto, 1, 1));
  image.width = static_cast<int>(proto.width());
  image.height = static_cast<int>(proto.height());
}

const FieldDescriptor* set_field(const Message& message, const std::string& oneof) {
  return message.GetReflection()->GetOneofFieldDescriptor(
      message, message.GetDescriptor()->FindOneofByName(oneof));
}

std::string names_of(const Message& message, const std::string& oneof) {
  const auto& fields = *message.GetDescriptor()->FindOneofByName(oneof);
  std::string names;
  for (int i = 0; i < fields.field_count(); ++i) {
    const bool last = i + 1 == fields.field_count();
    names += (i == 0 ? "" : last ? " and " : ", ") + fields.field(i)->name();
  }
  return names;
}

}  // namespace itn
