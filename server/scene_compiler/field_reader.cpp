#include "server/scene_compiler/field_reader.h"

#include <fmt/format.h>

#include "common/error.h"
#include "common/scene/scene_bytes.h"

namespace itn {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

namespace {

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
  const v1::Vec3* read = vec(name);
  value = normalize(non_zero(path(name), read == nullptr ? v1::Vec3() : *read));
}

void FieldReader::position(const char* name, Vec3d& value) const {
  if (const v1::Vec3* read = vec(name)) value = check_position(path(name), to_vec(*read));
}

void FieldReader::pixels(const char* name, tracer::EnvironmentMapLight& map) const {
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
