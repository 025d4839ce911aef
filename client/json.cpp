#include "client/json.h"

#include <google/protobuf/util/json_util.h>

#include "common/error.h"

namespace itn {

std::string to_json(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (!status.ok()) throw Error(ErrorKind::kInternal, status.ToString());
  return json;
}

}  // namespace itn
