// itn shapes: what can be written as `builtin` in a scene file, and shapes made at random; as a
// list, as files, as a picture.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "client/commands/command.h"
#include "client/contact_sheet.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/folder_lock.h"
#include "common/files/read_file.h"
#include "common/geometry/mesh_file.h"
#include "common/geometry/random_shape.h"
#include "common/geometry/shapes.h"
#include "common/progress.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// A larger picture would be of no use.
constexpr size_t kMostOnSheet = 1024;
constexpr size_t kMostRandom = 10'000'000;

struct ShapesOptions {
  size_t random = 0;  // 0: the built-in ones
  uint64_t seed = 0;
  std::string folder;
  std::string sheet;
  int side = 0;  // 0: by the number of shapes
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

void check(const ShapesOptions& options) {
  require_usage(options.random == 0 || !options.folder.empty() || !options.sheet.empty(),
                "--random: say where to: -o FOLDER for files, --sheet FILE for a picture");
  if (!options.sheet.empty()) {
    const std::string suffix = fs::path(options.sheet).extension().string();
    require_usage(suffix.empty() || suffix == ".png" || suffix == ".PNG",
                  fmt::format("--sheet {}: it is written as PNG, name it .png", options.sheet));
    require_usage(options.random <= kMostOnSheet,
                  fmt::format("--sheet: a picture of {} shapes is too large to look at; ask for {} "
                              "at most",
                              options.random, kMostOnSheet));
    check_writable(options.sheet);
  }
  if (!options.folder.empty()) check_folder_writable(options.folder);
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
  const std::string there =
      written < shapes.count() ? fmt::format(", {} were there", shapes.count() - written) : "";
  print_result("{}: {} shapes written{}\n", folder.string(), written, there);
}

void write_sheet(const Shapes& shapes, const ShapesOptions& options) {
  const auto columns =
      static_cast<size_t>(std::ceil(std::sqrt(static_cast<double>(shapes.count()))));
  // About 1600 pixels across, as far as shapes stay recognisable.
  const int side =
      options.side > 0 ? options.side : std::clamp(1600 / static_cast<int>(columns), 96, 320);
  Progress progress("drawing", "shapes", shapes.count());
  write_contact_sheet(options.sheet, shapes.count(), columns, side, [&](size_t i) {
    throw_if_interrupted();
    progress.update(i);
    return shapes.mesh(i);
  });
  progress.update(shapes.count());
  progress.finish();
  print_result(fmt::format("{}: {} to {}, row by row\n", options.sheet, shapes.name(0),
                           shapes.name(shapes.count() - 1)),
               is_stdout(options.sheet) ? stderr : stdout);
}

void run(const ShapesOptions& options) {
  check(options);
  const Shapes shapes(options);
  if (!options.folder.empty()) write_files(shapes, options.folder);
  if (!options.sheet.empty()) write_sheet(shapes, options);
  if (options.folder.empty() && options.sheet.empty()) list();
}

}  // namespace

void add_shapes_command(CLI::App& app) {
  const auto options = std::make_shared<ShapesOptions>();
  CLI::App* command = app.add_subcommand(
      "shapes", "List the built-in shapes, or make any number of random ones: files, a picture");
  CLI::Option* random =
      command
          ->add_option("--random", options->random,
                       "So many random shapes instead: random-SEED-0, random-SEED-1, ...; the "
                       "first ones of a larger number are the same")
          ->check(CLI::Range(size_t{1}, kMostRandom));
  command->add_option("--seed", options->seed, "Of the random shapes")
      ->check(CLI::NonNegativeNumber)
      ->needs(random)
      ->capture_default_str();
  command->add_option("-o,--output", options->folder,
                      "Folder to write the shapes to, as NAME.ply; what is there stays");
  CLI::Option* sheet = command->add_option(
      "--sheet", options->sheet, "PNG file to draw all shapes in, row by row; -: standard output");
  command
      ->add_option("--side", options->side,
                   "Pixels along a side of each shape's square; default: by their number")
      ->check(CLI::Range(16, 1024))
      ->needs(sheet);
  command->callback([options] { run(*options); });
}

}  // namespace itn
