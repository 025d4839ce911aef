// Image files, as photographs and as masks: OpenEXR, PNG, JPEG, TIFF, Radiance HDR, HEIF, WebP.
#include "client/image/photograph_file.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  const std::string bytes = testing::to_string(data, size);
  testing::expect_answer([&] { decode_photograph(bytes, "photograph"); });
  testing::expect_answer([&] { decode_mask(bytes, "mask"); });
  return 0;
}
