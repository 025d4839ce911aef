// Messages as JSON: one line, fields named as in the .proto, those of value 0 included.
#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace itn {

std::string to_json(const google::protobuf::Message& message);

}  // namespace itn
