#include "client/scene/text_proto.h"

#include <fmt/format.h>
#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/text_format.h>

#include <string_view>
#include <utility>

#include "common/error.h"

namespace itn {
namespace {

// Keeps the first error, with its position.
class FirstError final : public google::protobuf::io::ErrorCollector {
 public:
  explicit FirstError(std::string name) : name_(std::move(name)) {}

  void AddError(int line, google::protobuf::io::ColumnNumber column,
                const std::string& message) override {
    if (!message_.empty()) return;
    if (message == "Expected identifier, got: ") {
      AddError(line, column, "the file ends within a { that is not closed");
      return;
    }
    // Both are counted from 0; what is missing has no position.
    message_ = line < 0 ? fmt::format("{}: {}", name_, message)
                        : fmt::format("{}:{}:{}: {}", name_, line + 1, column + 1, message);
  }
  // Our files have none that is harmless.
  void AddWarning(int line, google::protobuf::io::ColumnNumber column,
                  const std::string& message) override {
    AddError(line, column, message);
  }

  const std::string& message() const { return message_; }

 private:
  std::string name_;
  std::string message_;
};

// A field of text files whose name itn 0.1 wrote otherwise.
constexpr std::string_view kFieldOf01 = "material_step:", kField = "first_order_step:";

std::string replaced(std::string text, std::string_view before, std::string_view after) {
  for (size_t at = 0; (at = text.find(before, at)) != std::string::npos; at += after.size()) {
    text.replace(at, before.size(), after);
  }
  return text;
}

}  // namespace

std::string to_text_proto(const google::protobuf::Message& message) {
  std::string text;
  google::protobuf::TextFormat::PrintToString(message, &text);
  return text;
}

std::string to_short_text_proto(const google::protobuf::Message& message) {
  google::protobuf::TextFormat::Printer printer;
  printer.SetUseShortRepeatedPrimitives(true);
  std::string text;
  printer.PrintToString(message, &text);
  return text;
}

std::string to_text_proto_of_01(const google::protobuf::Message& message) {
  return replaced(to_text_proto(message), kField, kFieldOf01);
}

void parse_text_proto(const std::string& text, const std::string& name,
                      google::protobuf::Message& message) {
  FirstError error(name);
  google::protobuf::TextFormat::Parser parser;
  parser.RecordErrorsTo(&error);
  const bool parsed = parser.ParseFromString(replaced(text, kFieldOf01, kField), &message);
  if (!parsed || !error.message().empty()) throw invalid_input(error.message());
}

}  // namespace itn
