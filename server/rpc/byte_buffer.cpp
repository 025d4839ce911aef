#include "server/rpc/byte_buffer.h"

#include <google/protobuf/io/zero_copy_stream.h>
#include <grpcpp/support/proto_buffer_reader.h>
#include <grpcpp/support/slice.h>

#include <memory>

namespace itn {

void parse_checked(const grpc::ByteBuffer& bytes, const std::string& path,
                   const ElementLimits& limits, google::protobuf::Message& message) {
  grpc::ByteBuffer copy = bytes;  // of the references; the reader wants them not const
  const auto open = [&]() -> std::unique_ptr<google::protobuf::io::ZeroCopyInputStream> {
    auto reader = std::make_unique<grpc::ProtoBufferReader>(&copy);
    if (!reader->status().ok()) return nullptr;
    return reader;
  };
  parse_checked(open, copy.Length(), path, limits, message);
}

grpc::ByteBuffer serialized(const google::protobuf::Message& message) {
  const size_t size = message.ByteSizeLong();
  grpc::Slice slice(size);
  // gRPC shows a slice as not to be written; this one is ours alone.
  auto* const begin = const_cast<uint8_t*>(slice.begin());
  message.SerializeWithCachedSizesToArray(begin);
  return {&slice, 1};
}

}  // namespace itn
