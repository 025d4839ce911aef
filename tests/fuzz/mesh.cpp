// Mesh files: whatever the bytes are, as PLY, as OBJ and as STL; what is read is repaired, as scene
// files and datasets may ask.
#include <array>

#include "client/geometry/mesh_file.h"
#include "client/geometry/mesh_repair.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temporary_folder.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  static const testing::TemporaryFolder folder;
  const std::string bytes = testing::to_string(data, size);
  for (const char* name : {"mesh.ply", "mesh.obj", "mesh.stl"}) {
    testing::expect_answer([&] { repaired(load_mesh(folder.write(name, bytes)), name); });
  }
  return 0;
}
