// A look at a serialized message before it is parsed, so that what parsing allocates is in
// proportion to its bytes: two bytes can make an empty submessage of a hundred.
#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/zero_copy_stream.h>
#include <google/protobuf/message.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <unordered_map>

namespace itn {

// The most elements of a repeated field, by its full name ("itn.v1.Scene.lights"), in one message
// that holds it.
using ElementLimits = std::unordered_map<std::string, uint64_t>;

// Throws Error (kInvalidInput) that names the place if the bytes are not a message of this type,
// hold a field that it does not have, or more elements of a repeated field than `limits` says; a
// repeated field of messages or numbers that has no limit may have 16. Allocates nothing. Time:
// linear.
void check_wire(google::protobuf::io::ZeroCopyInputStream& bytes, uint64_t size,
                const google::protobuf::Descriptor& type, const std::string& path,
                const ElementLimits& limits);

// Checks, then parses.
void parse_checked(const std::string& bytes, const std::string& path, const ElementLimits& limits,
                   google::protobuf::Message& message);

// The same of bytes that are not in one piece: `open` begins to read them, for the check and again
// for the parser. Where it gives null, they cannot be read, and are no message.
using OpenStream = std::function<std::unique_ptr<google::protobuf::io::ZeroCopyInputStream>()>;
void parse_checked(const OpenStream& open, uint64_t size, const std::string& path,
                   const ElementLimits& limits, google::protobuf::Message& message);

}  // namespace itn
