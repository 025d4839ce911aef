#include "server/wire/wire_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "common/error.h"
#include "itn/v1/render.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {
namespace {

using ::testing::HasSubstr;

std::string message_of(const std::string& bytes, google::protobuf::Message& into,
                       const ElementLimits& limits = {}) {
  try {
    parse_checked(bytes, "request", limits, into);
    return "";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
    return error.what();
  }
}

v1::RenderGradRequest some_request() {
  v1::RenderGradRequest request;
  request.set_scene(std::string(1000, 'x'));
  request.mutable_material()->set_sigma_t(3);
  request.set_spp(300);
  request.set_seed(~uint64_t{0});
  for (int i = 0; i < 5; ++i) request.add_derivatives(v1::G), request.add_albedos(0.5);
  request.mutable_loss()->set_image("abc");
  return request;
}

TEST(WireCheck, LetsPassWhatItShould) {
  const v1::RenderGradRequest request = some_request();
  v1::RenderGradRequest parsed;
  EXPECT_EQ(message_of(request.SerializeAsString(), parsed), "");
  EXPECT_EQ(parsed.SerializeAsString(), request.SerializeAsString());
  EXPECT_EQ(message_of("", parsed), "");
}

// Protobuf would merge them into one with the elements of both.
TEST(WireCheck, RefusesAMessageThatIsGivenTwice) {
  v1::Scene scene, parsed;
  scene.mutable_object()->mutable_mesh()->add_transforms();
  const std::string once = scene.SerializeAsString();
  EXPECT_EQ(message_of(once, parsed), "");
  EXPECT_THAT(message_of(once + once, parsed), HasSubstr("object is given more than once"));
}

TEST(WireCheck, RefusesEveryBeginningOfAMessageThatEndsInsideAField) {
  const std::string bytes = some_request().SerializeAsString();
  int refused = 0;
  for (size_t length = 0; length < bytes.size(); ++length) {
    v1::RenderGradRequest parsed;
    const bool fits = v1::RenderGradRequest().ParseFromString(bytes.substr(0, length));
    EXPECT_EQ(message_of(bytes.substr(0, length), parsed).empty(), fits) << length;
    refused += fits ? 0 : 1;
  }
  EXPECT_GT(refused, 1000);
}

TEST(WireCheck, BoundsElementsBeforeTheyAreParsed) {
  v1::Scene scene;
  std::string surfaces, floats;
  for (int i = 0; i < 2000; ++i) surfaces += std::string("\x12\x00", 2);
  EXPECT_THAT(message_of(surfaces, scene, {{"itn.v1.Scene.surfaces", 1024}}),
              HasSubstr("request.surfaces has more than 1024 elements"));
  EXPECT_EQ(message_of(surfaces, scene, {{"itn.v1.Scene.surfaces", 2000}}), "");
  // Packed and not: field 1 of Matrix.
  v1::Matrix matrix;
  for (int i = 0; i < 17; ++i) matrix.add_m(1);
  EXPECT_THAT(message_of(matrix.SerializeAsString(), matrix), HasSubstr("more than 16 elements"));
  for (int i = 0; i < 17; ++i) floats += std::string("\x0d\0\0\0\0", 5);
  EXPECT_THAT(message_of(floats, matrix), HasSubstr("more than 16 elements"));
}

TEST(WireCheck, NamesUnknownFieldsAndRefusesGroups) {
  v1::RenderGradRequest request;
  EXPECT_THAT(message_of(std::string("\xf8\x3f\x01", 3), request),
              HasSubstr("request has a field with the unknown number 1023"));
  EXPECT_THAT(message_of(std::string("\x1a\x02\x78\x01", 4), request),
              HasSubstr("request.material has a field with the unknown number 15"));
  for (const char* group : {"\x1b", "\x23\x24", "\x0b\x0c"}) {
    EXPECT_THAT(message_of(group, request), HasSubstr("not a serialized itn.v1.RenderGradRequest"));
  }
}

}  // namespace
}  // namespace itn
