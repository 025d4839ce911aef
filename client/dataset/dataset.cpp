#include "client/dataset/dataset.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include "client/dataset/sampler.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/geometry/mesh_file.h"
#include "common/geometry/mesh_repair.h"
#include "common/geometry/shapes.h"
#include "common/image/attributes.h"
#include "common/image/image.h"
#include "common/scene/material_proto.h"
#include "common/scene/text_proto.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// Branches of the tree of random choices below a dataset's seed.
enum Choice : uint64_t { kSplitChoice, kMaterialChoice, kRotationChoice, kRenderSeed };

// --- Shapes ---

bool is_mesh_file(const fs::path& path) {
  std::string extension = path.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char c) { return std::tolower(c); });
  return extension == ".ply" || extension == ".obj" || extension == ".stl";
}

std::vector<fs::path> mesh_files(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (entry.is_regular_file() && is_mesh_file(entry.path())) {
      files.push_back(entry.path());
    }
  }
  if (error) {
    throw Error(ErrorKind::kIo,
                fmt::format("cannot read {}: {}", folder.string(), error.message()));
  }
  std::ranges::sort(files);
  return files;
}

// `say`: what was repaired, if anything was.
Mesh load_shape(const fs::path& file, bool repair, bool say) {
  Mesh mesh = load_mesh(file);
  const std::string name = file.string();
  if (repair) {
    MeshRepair done = repaired(mesh, name);
    if (say && done.changed()) spdlog::warn("{} is repaired: {}", name, done.describe());
    mesh = std::move(done.mesh);
  } else {
    require_closed(mesh, name, "--repair");
  }
  return normalized(mesh);
}

// The bytes of its file in a dataset.
std::string serialized(const Mesh& mesh) {
  v1::Mesh proto;
  set_triangles(proto, mesh);
  return proto.triangles().SerializeAsString();
}

Shape described(std::string name, const Mesh& mesh, const std::string& bytes,
                std::function<std::string()> to_file) {
  return {.name = std::move(name),
          .height = bounds(mesh).max.y,
          .sha256 = to_hex(sha256(bytes)),
          .to_file = std::move(to_file)};
}

// --- The plan ---

void require(bool condition, const std::string& message) {
  if (!condition) {
    throw invalid_input(message);
  }
}

void validate_range(const char* name, const v1::Interval& range, double low, double high) {
  require(!(range.min() > range.max()),
          fmt::format("the range of {} is [{}, {}]; its minimum must not exceed its maximum", name,
                      range.min(), range.max()));
  require(range.min() <= range.max() && range.min() >= low && range.max() <= high,
          fmt::format("the range of {} is [{}, {}]; it must lie in [{}, {}]", name, range.min(),
                      range.max(), low, high));
}

void validate_config(const v1::DatasetConfig& config) {
  require(config.spp() >= 1, "spp must be 1 at least");
  require(config.test_fraction() > 0 && config.test_fraction() < 1,
          fmt::format("the test fraction is {}; it must be in (0, 1)", config.test_fraction()));
  validate_range("sigma_t", config.materials().sigma_t(), kMinSigmaT, kMaxSigmaT);
  validate_range("albedo", config.materials().albedo(), 0, 1);
  validate_range("g", config.materials().g(), -kMaxAbsG, kMaxAbsG);
  require(config.train_azimuths_degrees_size() > 0 && config.test_azimuths_degrees_size() > 0,
          "training and test need one sun azimuth each at least");
  // Turns by 360 degrees are the same illumination.
  const auto wrapped = [](double degrees) { return degrees - 360 * std::floor(degrees / 360); };
  for (const double train : config.train_azimuths_degrees()) {
    for (const double test : config.test_azimuths_degrees()) {
      require(wrapped(train) != wrapped(test),
              fmt::format("the sun azimuth {} is in both splits; they must share none", test));
    }
  }
}

std::set<std::string> choose_test_shapes(const v1::DatasetConfig& config,
                                         std::span<const Shape> shapes,
                                         std::span<const std::string> wanted) {
  std::set<std::string> names;
  for (const Shape& shape : shapes) {
    require(names.insert(shape.name).second,
            fmt::format("two shapes are called \"{}\"; rename one of them", shape.name));
  }
  require(
      names.size() >= 2,
      fmt::format("there are {} shapes; training and test need one each at least, as they share "
                  "none",
                  names.size()));
  std::set<std::string> test;
  for (const std::string& name : wanted) {
    require(names.contains(name), fmt::format("there is no shape \"{}\" to test with; there are {}",
                                              name, fmt::join(names, ", ")));
    test.insert(name);
  }
  require(test.size() < names.size(), "no shape is left to train with");
  if (test.empty()) {
    const auto count =
        std::clamp<size_t>(static_cast<size_t>(std::lround(config.test_fraction() *
                                                           static_cast<double>(names.size()))),
                           1, names.size() - 1);
    const std::vector<uint32_t> order = permutation(static_cast<uint32_t>(shapes.size()),
                                                    derive_seed(config.seed(), {kSplitChoice}));
    for (size_t i = 0; i < count; ++i) {
      test.insert(shapes[order[i]].name);
    }
  }
  return test;
}

void add_shape(DatasetPlan& plan, const Shape& shape, v1::Split split) {
  v1::DatasetShape& entry = *plan.manifest.add_shapes();
  entry.set_name(shape.name);
  entry.set_split(split);
  entry.set_file(fmt::format("shapes/{}.mesh", shape.name));
  entry.set_height(shape.height);
  entry.set_sha256(shape.sha256);
  plan.shape_files[entry.file()] = shape.to_file;
}

// From the unit cube: sigma_t log-uniform, albedo and g uniform.
v1::Material material_at(const v1::MaterialRange& range, const std::array<double, 3>& u) {
  const auto lerp = [](double a, double b, double t) { return a + (b - a) * t; };
  return to_proto(
      {std::exp(lerp(std::log(range.sigma_t().min()), std::log(range.sigma_t().max()), u[0])),
       lerp(range.albedo().min(), range.albedo().max(), u[1]),
       lerp(range.g().min(), range.g().max(), u[2])});
}

// `count` materials of one split. STRATIFIED is a Latin hypercube: each of the three coordinates
// falls into each of `count` equal strata exactly once.
std::vector<v1::Material> sampled_materials(const v1::DatasetConfig& config, v1::Split split,
                                            uint32_t count) {
  const auto branch = [&](uint64_t leaf) {
    return derive_seed(config.seed(), {kMaterialChoice, static_cast<uint64_t>(split), leaf});
  };
  const std::vector<uint32_t> strata[3] = {
      permutation(count, branch(0)), permutation(count, branch(1)), permutation(count, branch(2))};
  SplitMix random(branch(3));
  std::vector<v1::Material> materials;
  for (uint32_t i = 0; i < count; ++i) {
    std::array<double, 3> u;
    for (size_t k = 0; k < 3; ++k) {
      u[k] = random.uniform();
      if (config.sampling() == v1::DatasetConfig::STRATIFIED) {
        u[k] = (strata[k][i] + u[k]) / count;
      }
    }
    materials.push_back(material_at(config.materials(), u));
  }
  return materials;
}

std::vector<v1::Material> grid_materials(const v1::DatasetConfig& config) {
  std::vector<v1::Material> materials;
  for (const double sigma_t : config.grid_sigma_t()) {
    for (const double albedo : config.grid_albedo()) {
      for (const double g : config.grid_g()) {
        materials.push_back(to_proto({sigma_t, albedo, g}));
      }
    }
  }
  return materials;
}

// What is left to choose once shape, azimuth and material are.
void add_item(v1::Dataset& manifest, const v1::DatasetShape& shape, double azimuth,
              const v1::Material& material) {
  const v1::DatasetConfig& config = manifest.config();
  const auto index = static_cast<uint64_t>(manifest.items_size());
  v1::DatasetItem& item = *manifest.add_items();
  item.set_file(fmt::format("images/{:06}.exr", index));
  item.set_split(shape.split());
  item.set_shape(shape.name());
  if (config.rotate()) {
    SplitMix random(derive_seed(config.seed(), {kRotationChoice, index}));
    item.set_rotate_y_degrees(static_cast<float>(360 * random.uniform()));
  }
  item.set_sun_azimuth_degrees(static_cast<float>(azimuth));
  *item.mutable_material() = material;
  item.set_seed(derive_seed(config.seed(), {kRenderSeed, index}));
}

void add_items(v1::Dataset& manifest, v1::Split split, uint32_t count) {
  const v1::DatasetConfig& config = manifest.config();
  const auto& azimuths =
      split == v1::SPLIT_TRAIN ? config.train_azimuths_degrees() : config.test_azimuths_degrees();
  std::vector<v1::DatasetShape> shapes;
  std::ranges::copy_if(manifest.shapes(), std::back_inserter(shapes),
                       [split](const v1::DatasetShape& s) { return s.split() == split; });
  if (config.sampling() == v1::DatasetConfig::GRID) {
    const std::vector<v1::Material> materials = grid_materials(config);
    for (const v1::DatasetShape& shape : shapes) {
      for (const double azimuth : azimuths) {
        for (const v1::Material& material : materials) {
          add_item(manifest, shape, azimuth, material);
        }
      }
    }
    return;
  }
  // Shapes and azimuths in turn, so that each appears about equally often with each other.
  const std::vector<v1::Material> materials = sampled_materials(config, split, count);
  for (uint32_t i = 0; i < count; ++i) {
    const size_t shape = i % shapes.size();
    const int azimuth = static_cast<int>((i / shapes.size()) % azimuths.size());
    add_item(manifest, shapes[shape], azimuths.Get(azimuth), materials[i]);
  }
}

// --- Scenes ---

v1::Scene scene_of(const v1::DatasetConfig& config, const v1::DatasetShape& shape,
                   const v1::Triangles& triangles, const v1::DatasetItem& item) {
  v1::Scene scene = config.set_up();
  v1::Mesh& mesh = *scene.mutable_object()->mutable_mesh();
  *mesh.mutable_triangles() = triangles;
  if (item.rotate_y_degrees() != 0) {
    v1::Rotation& rotation = *mesh.add_transforms()->mutable_rotate();
    rotation.mutable_axis()->set_y(1);
    rotation.set_angle_degrees(item.rotate_y_degrees());
  }
  for (v1::Light& light : *scene.mutable_lights()) {
    if (light.has_sun_sky()) {
      light.mutable_sun_sky()->set_sun_azimuth_degrees(item.sun_azimuth_degrees());
    }
  }
  // The object is in the middle of the image.
  scene.mutable_camera()->mutable_target()->set_y(shape.height() / 2);
  return scene;
}

}  // namespace

Shape describe_shape(std::string name, std::function<Mesh()> load) {
  const Mesh mesh = load();
  return described(std::move(name), mesh, serialized(mesh),
                   [load = std::move(load)] { return serialized(load()); });
}

Shape describe_shape(std::string name, const Mesh& mesh) {
  const auto bytes = std::make_shared<const std::string>(serialized(mesh));
  return described(std::move(name), mesh, *bytes, [bytes] { return *bytes; });
}

ShapeSet builtin_shape_set() {
  ShapeSet set;
  for (const ShapeInfo& info : builtin_shapes()) {
    set.shapes.push_back(describe_shape(std::string(info.name), make_shape(info.name)));
  }
  std::ranges::sort(set.shapes, {}, &Shape::name);
  return set;
}

ShapeSet load_shape_set(const fs::path& folder, bool repair) {
  ShapeSet set;
  for (const fs::path& file : mesh_files(folder)) {
    try {
      const auto load = [file, repair, first = true]() mutable {
        return load_shape(file, repair, std::exchange(first, false));
      };
      set.shapes.push_back(describe_shape(file.stem().string(), load));
    } catch (const Error& error) {
      set.refused.emplace_back(error.what());
    }
  }
  if (set.shapes.empty()) {
    throw invalid_input(set.refused.empty()
                            ? fmt::format("{} holds no PLY, OBJ or STL file", folder.string())
                            : fmt::format("no mesh in {} can be used:\n  {}", folder.string(),
                                          fmt::join(set.refused, "\n  ")));
  }
  return set;
}

v1::DatasetConfig paper_config(uint32_t resolution) {
  v1::DatasetConfig config;
  v1::Scene& scene = *config.mutable_set_up();
  // Ground: a grey square of half-size 20.
  v1::Surface& ground = *scene.add_surfaces();
  ground.mutable_rectangle()->mutable_center();
  ground.mutable_rectangle()->mutable_half_u()->set_x(20);
  ground.mutable_rectangle()->mutable_half_v()->set_z(-20);
  ground.set_reflectance(0.5F);
  // Sky.
  v1::SunSky& sky = *scene.add_lights()->mutable_sun_sky();
  sky.set_turbidity(3);
  sky.set_sun_elevation_degrees(60);
  sky.set_sun_angular_radius_degrees(18.75F);
  // Camera: 15 degrees above the horizon.
  v1::Camera& camera = *scene.mutable_camera();
  camera.mutable_origin()->set_y(8.78F);
  camera.mutable_origin()->set_z(-32.8F);
  camera.set_fov_degrees(2.5F);
  scene.mutable_film()->set_width(resolution);
  scene.mutable_film()->set_height(resolution);
  // Materials.
  const auto set = [](v1::Interval* interval, double min, double max) {
    interval->set_min(min);
    interval->set_max(max);
  };
  set(config.mutable_materials()->mutable_sigma_t(), 30, 276);
  set(config.mutable_materials()->mutable_albedo(), 0.39, 0.95);
  set(config.mutable_materials()->mutable_g(), 0, 0.8);
  for (const double sigma_t : {30, 36, 44, 54, 67, 82, 100, 122, 150, 184, 225, 276}) {
    config.add_grid_sigma_t(sigma_t);
  }
  for (const double albedo : {0.39, 0.59, 0.74, 0.87, 0.95}) {
    config.add_grid_albedo(albedo);
  }
  for (const double g : {0.0, 0.2, 0.4, 0.6, 0.8}) {
    config.add_grid_g(g);
  }
  for (const double azimuth : {0, 30, 60, 90}) {
    config.add_train_azimuths_degrees(azimuth);
  }
  for (const double azimuth : {10, 20, 40, 50, 70, 80}) {
    config.add_test_azimuths_degrees(azimuth);
  }
  config.set_sampling(v1::DatasetConfig::STRATIFIED);
  config.set_test_fraction(0.25);
  return config;
}

DatasetPlan plan_dataset(const v1::DatasetConfig& config, std::span<const Shape> shapes,
                         std::span<const std::string> test_shapes) {
  validate_config(config);
  DatasetPlan plan;
  *plan.manifest.mutable_config() = config;
  // Split the shapes.
  const std::set<std::string> test = choose_test_shapes(config, shapes, test_shapes);
  for (const Shape& shape : shapes) {
    add_shape(plan, shape, test.contains(shape.name) ? v1::SPLIT_TEST : v1::SPLIT_TRAIN);
  }
  // Choose the items of each split.
  const auto test_count =
      static_cast<uint32_t>(std::lround(config.test_fraction() * config.count()));
  if (config.sampling() != v1::DatasetConfig::GRID) {
    require(test_count >= 1 && test_count < config.count(),
            fmt::format("of {} images, with a test fraction of {}, {} are to test with; training "
                        "and test need one each at least: choose more images, or another fraction",
                        config.count(), config.test_fraction(), test_count));
  }
  add_items(plan.manifest, v1::SPLIT_TRAIN, config.count() - test_count);
  add_items(plan.manifest, v1::SPLIT_TEST, test_count);
  return plan;
}

std::string item_digest(const v1::Dataset& manifest, const v1::DatasetItem& item) {
  std::string content = item.SerializeAsString() + manifest.config().set_up().SerializeAsString() +
                        std::to_string(manifest.config().spp());
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    if (shape.name() == item.shape()) {
      content += shape.sha256();
    }
  }
  return to_hex(sha256(content));
}

std::string to_text(const v1::Dataset& manifest) {
  return to_text_proto(manifest);
}

v1::Dataset read_manifest(const fs::path& path) {
  v1::Dataset manifest;
  parse_text_proto(read_file(path, "manifest"), path.string(), manifest);
  const auto require_inside = [&](const std::string& file) {
    const fs::path relative(file);
    require(
        relative.is_relative() && relative.has_filename() && relative != "." &&
            std::ranges::find(relative, fs::path("..")) == relative.end(),
        fmt::format("{}: \"{}\" is not a file in the folder of the dataset", path.string(), file));
  };
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    require_inside(shape.file());
  }
  for (const v1::DatasetItem& item : manifest.items()) {
    require_inside(item.file());
  }
  return manifest;
}

fs::path path_inside(const fs::path& folder, const std::string& file) {
  const fs::path path = folder / file;
  std::error_code error;
  if (fs::exists(fs::symlink_status(path, error))) {
    const fs::path base = fs::weakly_canonical(folder, error);
    const fs::path target = fs::weakly_canonical(path, error);
    require(!error && fs::is_regular_file(target, error) &&
                std::mismatch(base.begin(), base.end(), target.begin(), target.end()).first ==
                    base.end(),
            fmt::format("{} is not a regular file in the folder of the dataset", path.string()));
  }
  return path;
}

bool holds_shape(const fs::path& folder, const v1::DatasetShape& shape) {
  const fs::path path = path_inside(folder, shape.file());
  return fs::exists(path) && to_hex(sha256(read_file(path, "shape"))) == shape.sha256();
}

DatasetReader::DatasetReader(fs::path folder)
    : folder_(std::move(folder)), manifest_(read_manifest(folder_ / kManifestName)) {
  for (const v1::DatasetShape& shape : manifest_.shapes()) {
    shapes_[shape.name()] = &shape;
  }
  for (const v1::DatasetItem& item : manifest_.items()) {
    require(shapes_.contains(item.shape()),
            fmt::format("{}: {} is of a shape \"{}\" that is not listed",
                        (folder_ / kManifestName).string(), item.file(), item.shape()));
    require(item.split() == shapes_[item.shape()]->split(),
            fmt::format("{}: {} is not in the split of its shape",
                        (folder_ / kManifestName).string(), item.file()));
  }
}

int DatasetReader::resolution() const {
  return static_cast<int>(manifest_.config().set_up().film().width());
}

std::vector<const v1::DatasetItem*> DatasetReader::items(v1::Split split) const {
  std::vector<const v1::DatasetItem*> result;
  for (const v1::DatasetItem& item : manifest_.items()) {
    if (item.split() == split) {
      result.push_back(&item);
    }
  }
  return result;
}

namespace {

double relative_noise(const DatasetImage& image, std::span<const float> standard_error) {
  double error = 0, radiance = 0;
  for (size_t p = 0; p < image.mask.size(); ++p) {
    error += image.mask[p] * std::pow(static_cast<double>(standard_error[p]), 2);
    radiance += image.mask[p] * std::pow(static_cast<double>(image.radiance[p]), 2);
  }
  return radiance > 0 ? std::sqrt(error / radiance) : 0;
}

}  // namespace

DatasetImage DatasetReader::image(const v1::DatasetItem& item) const {
  const fs::path path = path_inside(folder_, item.file());
  if (!fs::exists(path)) {
    throw Error(ErrorKind::kIo,
                fmt::format("{} is missing: the dataset is not complete; the command that began it "
                            "continues it",
                            path.string()));
  }
  const Image image = read_exr(path);
  const auto digest = image.attributes.find(attribute::kItem);
  require(digest != image.attributes.end() &&
              digest->second == Attribute(item_digest(manifest_, item)) &&
              image.width == resolution() && image.height == resolution(),
          fmt::format("{} is not the image that the manifest describes", path.string()));
  DatasetImage result{image.channel("Y"), image.channel("mask.Y")};
  result.relative_noise = relative_noise(result, image.channel("stderr.Y"));
  return result;
}

const v1::Triangles& DatasetReader::triangles(const v1::DatasetShape& shape) {
  if (const auto known = triangles_.find(shape.name()); known != triangles_.end()) {
    return known->second;
  }
  const fs::path path = path_inside(folder_, shape.file());
  const std::string bytes = read_file(path, "shape");
  v1::Triangles triangles;
  if (to_hex(sha256(bytes)) != shape.sha256() || !triangles.ParseFromString(bytes)) {
    throw Error(
        ErrorKind::kDataLoss,
        fmt::format(
            "{} is not the shape that the dataset was rendered with; the command that began "
            "the dataset, with its --shapes, writes it again",
            path.string()));
  }
  // Items of a shape are mostly asked for one after the other.
  constexpr size_t kMaxTriangleBytes = size_t{64} << 20;
  if (triangle_bytes_ + bytes.size() > kMaxTriangleBytes) {
    triangles_.clear();
    triangle_bytes_ = 0;
  }
  triangle_bytes_ += bytes.size();
  return triangles_[shape.name()] = std::move(triangles);
}

std::shared_ptr<const SerializedScene> DatasetReader::scene(const v1::DatasetItem& item) {
  const v1::DatasetShape& shape = *shapes_.at(item.shape());
  return serialize(scene_of(manifest_.config(), shape, triangles(shape), item));
}

}  // namespace itn
