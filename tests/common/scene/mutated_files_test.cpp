// Damaged files: whatever a byte says, reading ends with a message, soon and in little memory.
// ITN_MUTATED_FILES sets how many of each kind are tried.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "common/error.h"
#include "common/files/read_file.h"
#include "common/image/image.h"
#include "common/scene/scene_file.h"
#include "common/scene/text_proto.h"
#include "itn/v1/learning.pb.h"
#include "tests/support/scene_files.h"

namespace itn {
namespace {

using testing::kSceneFile;
using testing::TemporaryFolder;

int files_of_a_kind() {
  const char* wanted = std::getenv("ITN_MUTATED_FILES");
  return wanted != nullptr ? std::atoi(wanted) : 60;
}

// Some bytes changed, most of them near the start, where headers are; sometimes cut or grown.
std::string mutated(std::string bytes, std::mt19937& random) {
  const auto below = [&](size_t n) {
    return std::uniform_int_distribution<size_t>(0, n - 1)(random);
  };
  for (size_t i = 1 + below(8); i > 0; --i) {
    const size_t end = below(2) ? bytes.size() : std::min<size_t>(bytes.size(), 400);
    static constexpr unsigned char kExtremes[] = {0x00, 0x01, 0x7f, 0x80, 0xff};
    bytes[below(end)] = static_cast<char>(below(2) ? kExtremes[below(5)] : below(256));
  }
  if (below(4) == 0) bytes.resize(1 + below(bytes.size()));
  if (below(8) == 0) bytes.insert(below(bytes.size()), bytes.substr(below(bytes.size())));
  return bytes;
}

long peak_megabytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss / 1024;
}

// `read` reads the bytes; it may throw Error alone, which any other exception ends the test with.
template <typename Read>
void expect_survived(const std::string& whole, const Read& read) {
  constexpr long kMostMegabytes = 300;
  const long before = peak_megabytes();
  int refused = 0;
  for (int seed = 0; seed < files_of_a_kind(); ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(static_cast<unsigned>(seed));
    try {
      read(mutated(whole, random));
    } catch (const Error& error) {
      EXPECT_NE(exit_code(error.kind()), exit_code(ErrorKind::kInternal)) << error.what();
      ++refused;
    }
  }
  EXPECT_GT(refused, files_of_a_kind() / 4);
  EXPECT_LT(peak_megabytes() - before, kMostMegabytes);
}

TEST(MutatedFiles, Images) {
  const TemporaryFolder folder;
  std::mt19937 random(1);
  Image image{
      .width = 40, .height = 60, .channels = {}, .attributes = {{"note", "text"}, {"n", 3}}};
  for (const char* name : {"Y", "mask.Y", "sigma_t.Y"}) {
    std::vector<float>& plane = image.channels[name];
    for (int i = 0; i < 40 * 60; ++i) plane.push_back(static_cast<float>(random() % 100));
  }
  write_exr(folder.path("whole.exr"), image);
  expect_survived(read_file(folder.path("whole.exr"), "image"),
                  [](const std::string& bytes) { decode_exr(bytes, "mutated.exr"); });
}

TEST(MutatedFiles, Scenes) {
  const TemporaryFolder folder;
  expect_survived(kSceneFile, [&](const std::string& bytes) {
    load_scene(folder.write("mutated.textproto", bytes));
  });
}

TEST(MutatedFiles, Manifests) {
  const std::string manifest = R"(config { spp: 4 seed: 7 }
shapes { name: "cube" file: "shapes/cube.mesh" sha256: "00" split: SPLIT_TRAIN }
items { file: "images/000000.exr" shape: "cube" split: SPLIT_TRAIN seed: 1
  material { sigma_t: 30 albedo: 0.9 g: 0.1 } }
)";
  expect_survived(manifest, [](const std::string& bytes) {
    v1::Dataset dataset;
    parse_text_proto(bytes, "manifest.textproto", dataset);
  });
}

}  // namespace
}  // namespace itn
