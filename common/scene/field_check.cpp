#include "common/scene/field_check.h"

#include <google/protobuf/unknown_field_set.h>

#include <cmath>

namespace itn {
namespace {

constexpr double kMaxCoordinate = 1e6;  // in mm

}  // namespace

Error missing(const std::string& field) {
  return invalid_input(fmt::format("{} is missing; it is required", field));
}

uint32_t integer_in(const std::string& field, uint64_t value, uint64_t low, uint64_t high) {
  if (value < low || value > high) {
    throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", field, value, low, high));
  }
  return static_cast<uint32_t>(value);
}

void within_limit(const std::string& what, uint64_t value, uint64_t limit) {
  if (value > limit) {
    throw Error(ErrorKind::kLimit,
                fmt::format("{} is {}; this worker accepts at most {}", what, value, limit));
  }
}

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

namespace {

void check_finite(double value, const std::string& path) {
  if (!std::isfinite(value)) {
    throw invalid_input(fmt::format("{} is {}; it must be finite", path, value));
  }
}

void check_single(const Message& message, const FieldDescriptor& field, const std::string& path) {
  const auto& reflection = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return check_message(reflection.GetMessage(message, &field), path);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return check_finite(reflection.GetFloat(message, &field), path);
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return check_finite(reflection.GetDouble(message, &field), path);
    default: return;
  }
}

void check_element(const Message& message, const FieldDescriptor& field, int i,
                   const std::string& path) {
  const auto& reflection = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return check_message(reflection.GetRepeatedMessage(message, &field, i), path);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return check_finite(reflection.GetRepeatedFloat(message, &field, i), path);
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return check_finite(reflection.GetRepeatedDouble(message, &field, i), path);
    default: return;
  }
}

}  // namespace

void check_message(const Message& message, const std::string& path) {
  const auto& reflection = *message.GetReflection();
  if (const auto& unknown = reflection.GetUnknownFields(message); !unknown.empty()) {
    throw invalid_input(
        fmt::format("{} has a field with the unknown number {}", path, unknown.field(0).number()));
  }
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    const std::string name = path + "." + field->name();
    if (!field->is_repeated()) {
      check_single(message, *field, name);
      continue;
    }
    for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
      check_element(message, *field, i, fmt::format("{}[{}]", name, i));
    }
  }
}

Vec3d to_vec(const v1::Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

Vec3d non_zero(const std::string& field, const v1::Vec3& proto) {
  const Vec3d v = to_vec(proto);
  if (!(length(v) > 0)) {
    throw invalid_input(fmt::format("{} is (0, 0, 0); it must have a length", field));
  }
  return v;
}

Vec3d check_position(const std::string& field, Vec3d p) {
  for (const double c : {p.x, p.y, p.z}) {
    // Negated so that NaN fails too.
    if (!(std::abs(c) <= kMaxCoordinate)) {
      throw invalid_input(fmt::format("{} has a coordinate of {} mm; it must be in [{}, {}]", field,
                                      c, -kMaxCoordinate, kMaxCoordinate));
    }
  }
  return p;
}

}  // namespace itn
