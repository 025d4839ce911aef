// itn shapes: what can be written as `builtin` in a scene file, and shapes made at random; as a
// list or as files.
#include <fmt/format.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "client/commands/command.h"
#include "client/files/folder_lock.h"
#include "client/geometry/mesh_file.h"
#include "client/geometry/random_shape.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "client/progress.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/geometry/shapes.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxRandom = 10'000'000;

struct ShapesOptions {
  size_t random = 0;  // 0: the built-in ones
  uint64_t seed = 0;
  std::string folder;
};

// The shapes that are asked for.
class Shapes {
 public:
  explicit Shapes(const ShapesOptions& options) : random_(options.random), seed_(options.seed) {}

  size_t count() const { return random_ > 0 ? random_ : builtin_shapes().size(); }
  std::string name(size_t i) const {
    return random_ > 0 ? random_shape_name(seed_, i) : std::string(builtin_shapes()[i].name);
  }
  Mesh mesh(size_t i) const {
    return random_ > 0 ? random_shape(random_shape_seed(seed_, i))
                       : make_shape(builtin_shapes()[i].name);
  }

 private:
  size_t random_;
  uint64_t seed_;
};

void list() {
  for (const ShapeInfo& shape : builtin_shapes()) {
    print_result("{:<16} {}\n", shape.name, shape.description);
  }
}

// Whether it is there already. A file of that name that is something else is nobody's to replace.
bool is_there(const fs::path& file, const std::string& bytes) {
  if (!fs::exists(fs::symlink_status(file))) return false;
  if (fs::is_regular_file(file) && fs::file_size(file) == bytes.size() &&
      read_file(file, "shape") == bytes) {
    return true;
  }
  throw Error(ErrorKind::kIo,
              fmt::format("{} is there, and is not what would be written; it stays. Name another "
                          "folder, or remove it",
                          file.string()));
}

void write_files(const Shapes& shapes, const fs::path& folder) {
  const FolderLock lock(folder, "writing shapes");
  lock.remove_temporary_files();
  Progress progress("writing", "shapes", shapes.count());
  size_t written = 0;
  for (size_t i = 0; i < shapes.count(); ++i) {
    throw_if_interrupted();
    const fs::path file = folder / (shapes.name(i) + ".ply");
    const std::string bytes = encode_ply(shapes.mesh(i));
    if (!is_there(file, bytes)) {
      write_file_atomically(file, bytes);
      ++written;
    }
    progress.update(i + 1);
  }
  progress.finish();
  const std::string existing =
      written < shapes.count() ? fmt::format(", {} were there", shapes.count() - written) : "";
  print_result("{}: {} shapes written{}\n", folder.string(), written, existing);
}

void run(const ShapesOptions& options) {
  if (options.folder.empty()) {
    require_usage(options.random == 0, "--random-shapes: say where to: -o FOLDER");
    return list();
  }
  const std::string extension = fs::path(options.folder).extension().string();
  require_usage(extension != ".ply" && extension != ".stl" && extension != ".obj",
                fmt::format("-o {}: it names a folder, for files of all shapes", options.folder));
  check_folder_writable(options.folder);
  write_files(Shapes(options), options.folder);
}

}  // namespace

void add_shapes_command(CLI::App& app) {
  const auto options = std::make_shared<ShapesOptions>();
  CLI::App* command = app.add_subcommand(
      "shapes", "List the built-in shapes, or write them, or any number of random ones, as files");
  CLI::Option* random =
      command
          ->add_option("--random-shapes,--random", options->random,
                       "So many random shapes instead: random-SEED-0, random-SEED-1, ...; the "
                       "first ones of a larger number are the same")
          ->check(CLI::Range(size_t{1}, kMaxRandom));
  command->add_option("--shape-seed,--seed", options->seed, "Of the random shapes")
      ->check(CLI::NonNegativeNumber)
      ->needs(random)
      ->capture_default_str();
  command->add_option("-o,--output", options->folder,
                      "Folder to write the shapes to, as NAME.ply; what is there stays");
  command->callback([options] { run(*options); });
}

}  // namespace itn
