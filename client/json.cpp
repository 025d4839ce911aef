#include "client/json.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <memory>
#include <string_view>
#include <vector>

#include "common/error.h"
#include "common/printable.h"

namespace itn {

namespace {

// How many bytes the character at the front has as UTF-8; 0 if it is none.
size_t utf8_length(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  const size_t length = byte(0) < 0x80   ? 1
                        : byte(0) < 0xC2 ? 0
                        : byte(0) < 0xE0 ? 2
                        : byte(0) < 0xF0 ? 3
                        : byte(0) < 0xF5 ? 4
                                         : 0;
  if (length > text.size()) return 0;
  for (size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0U) != 0x80) return 0;
  }
  return length;
}

// JSON is UTF-8. Names of files need not be: other bytes become \xNN.
std::string as_utf8(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const size_t length = utf8_length(text);
    if (length == 0) {
      result += fmt::format("\\x{:02x}", static_cast<unsigned char>(text.front()));
    } else {
      result += text.substr(0, length);
    }
    text.remove_prefix(std::max<size_t>(1, length));
  }
  return result;
}

void make_utf8(google::protobuf::Message& message) {
  using Field = google::protobuf::FieldDescriptor;
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  std::vector<const Field*> fields;
  reflection.ListFields(message, &fields);
  for (const Field* const field : fields) {
    if (field->type() == Field::TYPE_STRING && field->is_repeated()) {
      for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
        reflection.SetRepeatedString(&message, field, i,
                                     as_utf8(reflection.GetRepeatedString(message, field, i)));
      }
    } else if (field->type() == Field::TYPE_STRING) {
      reflection.SetString(&message, field, as_utf8(reflection.GetString(message, field)));
    } else if (field->cpp_type() == Field::CPPTYPE_MESSAGE && field->is_repeated()) {
      for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
        make_utf8(*reflection.MutableRepeatedMessage(&message, field, i));
      }
    } else if (field->cpp_type() == Field::CPPTYPE_MESSAGE) {
      make_utf8(*reflection.MutableMessage(&message, field));
    }
  }
}

}  // namespace

std::string to_json(const google::protobuf::Message& original) {
  const std::unique_ptr<google::protobuf::Message> copy(original.New());
  copy->CopyFrom(original);
  google::protobuf::Message& message = *copy;
  make_utf8(message);
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (!status.ok()) throw Error(ErrorKind::kInternal, status.ToString());
  return json;
}

void from_json(const std::string& text, const std::string& name,
               google::protobuf::Message& message) {
  const auto status = google::protobuf::util::JsonStringToMessage(text, &message);
  if (status.ok()) return;
  throw invalid_input(fmt::format("{} is no {} as JSON: {}", printable(name),
                                  message.GetDescriptor()->name(), printable(status.ToString())));
}

}  // namespace itn
