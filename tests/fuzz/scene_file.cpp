// Scene files, with the files that they name; what the client makes of one is built as the worker
// does.
#include "client/scene/scene_file.h"
#include "client/geometry/mesh_file.h"
#include "client/image/image.h"
#include "client/object_media.h"
#include "common/geometry/shapes.h"
#include "server/scene_compiler/scene_builder.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/message_mutation.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

// With what the scene files of the corpus name.
class SceneFolder {
 public:
  SceneFolder() {
    folder_.write("cube.ply", encode_ply(make_shape("cube")));
    Image sky{.width = 4, .height = 2, .channels = {}, .attributes = {}};
    sky.channels["Y"] = std::vector<float>(8, 1.0F);
    write_exr(folder_.path("sky.exr"), sky);
  }
  std::filesystem::path write(const std::string& scene) const {
    return folder_.write("scene.textproto", scene);
  }

 private:
  testing::TemporaryFolder folder_;
};

}  // namespace
}  // namespace itn

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  static const SceneFolder folder;
  testing::expect_answer([&] {
    v1::Scene scene = load_scene(folder.write(testing::to_string(data, size)));
    resolve_media(scene);
    build_scene(parse_scene(serialize(scene)->bytes), {.max_pixels = 4096, .max_triangles = 4096});
  });
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  using namespace itn;
  return testing::mutated_input(data, size, max_size, seed,
                                testing::change_text(v1::Scene::default_instance()));
}
