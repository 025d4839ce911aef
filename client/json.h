// Messages as JSON: one line, fields named as in the .proto, those of value 0 included.
#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace itn {

std::string to_json(const google::protobuf::Message& message);

// Into an empty message. Throws Error (invalid input) if the text is none of such a message; `name`
// says where it comes from.
void from_json(const std::string& text, const std::string& name,
               google::protobuf::Message& message);

}  // namespace itn
