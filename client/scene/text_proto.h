// Protobuf messages as text, in protobuf text format, and back.
#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace itn {

// The message as text, of which parse_text_proto() makes an equal message.
std::string to_text_proto(const google::protobuf::Message& message);

// Likewise, with each list of numbers in a line.
std::string to_short_text_proto(const google::protobuf::Message& message);

// The text with the names that fields had in itn 0.1. Digests of an experiment's stages are of it,
// so that experiments of then go on.
std::string to_text_proto_of_01(const google::protobuf::Message& message);

// Parses `text` into `message`, with names of itn 0.1, too. Throws Error (invalid input) with
// `name`, line and column, at the first error; unknown fields and all that the parser warns of are
// errors.
void parse_text_proto(const std::string& text, const std::string& name,
                      google::protobuf::Message& message);

}  // namespace itn
