// Manifests of datasets, as they are and with a checksum that is right; the scene of each image is
// made as a training does.
#include "client/dataset/dataset.h"
#include "client/dataset/shape_set.h"
#include "common/scene/scene_bytes.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/message_mutation.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

// With the shapes of the corpus's manifests.
class DatasetFolder {
 public:
  DatasetFolder() {
    std::filesystem::create_directory(folder_.path("shapes"));
    const std::vector<std::string> names{"cube", "frame"};
    for (const Shape& shape : builtin_shape_set(names).shapes) {
      folder_.write("shapes/" + shape.name + ".mesh", shape.to_file());
    }
  }
  std::filesystem::path write(const std::string& manifest) const {
    folder_.write(kManifestName, manifest);
    return folder_.path();
  }

 private:
  testing::TemporaryFolder folder_;
};

std::string with_checksum(const std::string& text) {
  const std::string line = to_text(v1::Dataset());
  const std::string name = line.substr(0, line.rfind(' ') + 1);
  const size_t end = text.find('\n');
  const std::string below =
      text.starts_with(name) && end != std::string::npos ? text.substr(end + 1) : text;
  return name + to_hex(sha256(below)) + '\n' + below;
}

void expect_answer(const std::filesystem::path& folder) {
  testing::expect_answer([&] {
    DatasetReader dataset(folder);
    for (const v1::DatasetItem& item : dataset.manifest().items()) {
      dataset.digest(item);
      dataset.scene(item);
    }
  });
}

}  // namespace
}  // namespace itn

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  static const DatasetFolder folder;
  const std::string text = testing::to_string(data, size);
  expect_answer(folder.write(text));
  expect_answer(folder.write(with_checksum(text)));
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  using namespace itn;
  return testing::mutated_input(data, size, max_size, seed,
                                testing::change_text(v1::Dataset::default_instance()));
}
