#include "server/rpc/byte_buffer.h"

#include <gtest/gtest.h>

#include <string>

#include "common/error.h"
#include "itn/v1/render.pb.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

TEST(ByteBuffer, HoldsAMessage) {
  v1::RenderGradRequest request, parsed;
  request.set_scene(std::string(1000, 'x'));
  request.set_spp(300);
  parse_checked(serialized(request), "request", {}, parsed);
  EXPECT_EQ(parsed.SerializeAsString(), request.SerializeAsString());
}

TEST(ByteBuffer, OfSeveralPiecesIsChecked) {
  const grpc::Slice pieces[] = {grpc::Slice("\x10"), grpc::Slice("\xff\xff\xff")};
  v1::RenderGradRequest parsed;
  testing::expect_error(ErrorKind::kInvalidInput,
                        {"request: these bytes are not a serialized itn.v1.RenderGradReq"},
                        [&] { parse_checked(grpc::ByteBuffer(pieces, 2), "request", {}, parsed); });
}

}  // namespace
}  // namespace itn
