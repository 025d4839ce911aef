// Protobuf text format files.
#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace itn {

// Reads back equal.
std::string to_text_proto(const google::protobuf::Message& message);

// With the names that fields had in itn 0.1: digests that go on from then are of this text.
std::string to_text_proto_of_01(const google::protobuf::Message& message);

// Names of itn 0.1 are understood. Throws Error (invalid input) with `name`, line and column, at
// the first error; unknown fields and all that the parser warns of are errors.
void parse_text_proto(const std::string& text, const std::string& name,
                      google::protobuf::Message& message);

}  // namespace itn
