#include "common/scene/scene_file.h"

#include <fmt/format.h>
#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/text_format.h>

#include <fstream>
#include <utility>

#include "common/error.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_file.h"
#include "common/geometry/shapes.h"
#include "common/image/image.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// Keeps the first error, with its position. Warnings are errors: a scene file has none that are
// harmless.
class FirstError : public google::protobuf::io::ErrorCollector {
 public:
  explicit FirstError(std::string file) : file_(std::move(file)) {}

  void AddError(int line, google::protobuf::io::ColumnNumber column,
                const std::string& message) override {
    if (!message_.empty()) return;
    // Both are counted from 0; a missing field has no position.
    message_ = line < 0 ? fmt::format("{}: {}", file_, message)
                        : fmt::format("{}:{}:{}: {}", file_, line + 1, column + 1, message);
  }
  void AddWarning(int line, google::protobuf::io::ColumnNumber column,
                  const std::string& message) override {
    AddError(line, column, message);
  }

  const std::string& message() const { return message_; }

 private:
  std::string file_;
  std::string message_;
};

v1::Scene parse(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!fs::is_regular_file(path) || !in) {
    throw Error(ErrorKind::kIo, fmt::format("cannot open the scene {}", path.string()));
  }
  FirstError errors(path.string());
  google::protobuf::TextFormat::Parser parser;
  parser.RecordErrorsTo(&errors);
  google::protobuf::io::IstreamInputStream stream(&in);
  v1::Scene scene;
  const bool parsed = parser.Parse(&stream, &scene);
  if (!parsed || !errors.message().empty()) throw invalid_input(errors.message());
  return scene;
}

void resolve(v1::Mesh& mesh, const fs::path& folder) {
  if (mesh.has_path()) {
    set_triangles(mesh, load_mesh(folder / mesh.path()));
  } else if (mesh.has_builtin()) {
    check_shape_name(mesh.builtin());  // the worker builds it
  }
}

void resolve(v1::EnvironmentMap& map, const fs::path& folder) {
  if (!map.has_path()) return;
  const fs::path path = folder / map.path();
  const Image image = read_exr(path);
  const bool coloured = image.has("R") && image.has("G") && image.has("B");
  if (!coloured && !image.has("Y")) {
    throw invalid_input(
        fmt::format("{}: an environment map needs channels R, G, B, or Y", path.string()));
  }
  const auto plane = [&](const char* name) -> const std::vector<float>& {
    return image.channel(coloured ? name : "Y");
  };
  const auto &r = plane("R"), &g = plane("G"), &b = plane("B");
  std::string rgb;
  rgb.reserve(3 * sizeof(float) * r.size());
  for (size_t i = 0; i < r.size(); ++i) {
    for (const float value : {r[i], g[i], b[i]}) append_little_endian(rgb, value);
  }
  v1::Pixels& pixels = *map.mutable_pixels();  // takes the place of the path
  pixels.set_width(static_cast<uint32_t>(image.width));
  pixels.set_height(static_cast<uint32_t>(image.height));
  pixels.set_rgb(std::move(rgb));
}

}  // namespace

v1::Scene load_scene(const fs::path& path) {
  v1::Scene scene = parse(path);
  const fs::path folder = path.parent_path();
  if (scene.object().has_mesh()) resolve(*scene.mutable_object()->mutable_mesh(), folder);
  for (v1::Surface& surface : *scene.mutable_surfaces()) {
    if (surface.has_mesh()) resolve(*surface.mutable_mesh(), folder);
  }
  for (v1::Light& light : *scene.mutable_lights()) {
    if (light.has_environment_map()) resolve(*light.mutable_environment_map(), folder);
  }
  return scene;
}

}  // namespace itn
