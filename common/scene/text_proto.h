// Protobuf text format files.
#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace itn {

// Reads back equal.
std::string to_text_proto(const google::protobuf::Message& message);

// Throws Error (invalid input) with `name`, line and column, at the first error; unknown fields and
// all that the parser warns of are errors.
void parse_text_proto(const std::string& text, const std::string& name,
                      google::protobuf::Message& message);

}  // namespace itn
