#include "client/exports/mitsuba_scene_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "client/geometry/mesh_file.h"
#include "client/image/attributes.h"
#include "client/image/image.h"
#include "client/object_media.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "server/exports/mitsuba_scene.h"

namespace itn {
namespace {

// One, where all channels have the same.
std::vector<Material> alike_as_one(std::vector<Material> materials) {
  const auto is_first = [&](const Material& m) { return m == materials[0]; };
  if (std::ranges::all_of(materials, is_first)) materials.resize(1);
  return materials;
}

// In the channels of the image.
std::vector<Material> materials_of(const std::string& field, const v1::Object& object,
                                   std::span<const ImageChannel> channels) {
  std::vector<Material> materials;
  for (const ImageChannel& channel : channels) {
    const std::optional<Material> material = material_of(field, object, channel.shown);
    require(material.has_value(), field + ": it has no medium and no material");
    materials.push_back(*material);
  }
  return alike_as_one(std::move(materials));
}

Image image_of(const MitsubaFiles::Picture& picture) {
  Image image;
  if (picture.is_panorama) image.attributes[attribute::kRowsAtEnds] = 1;
  image.width = picture.width;
  image.height = picture.height;
  for (size_t c = 0; c < 3; ++c) {
    std::vector<float>& plane = image.channels[std::string(1, "RGB"[c])];
    for (size_t i = c; i < picture.rgb.size(); i += 3) plane.push_back(picture.rgb[i]);
  }
  return image;
}

}  // namespace

std::vector<std::string> write_mitsuba_scene(const std::filesystem::path& path,
                                             const v1::Scene& scene, const ImageRequest& request) {
  check_writable(path);
  const std::vector<ImageChannel> channels = channels_of(request, scene);
  std::vector<Material> of_object;
  for (const ImageChannel& channel : channels) of_object.push_back(channel.material);
  std::vector<std::vector<Material>> media{alike_as_one(std::move(of_object))};
  for (int i = 0; i < scene.other_objects_size(); ++i) {
    media.push_back(
        materials_of(fmt::format("scene.other_objects[{}]", i), scene.other_objects(i), channels));
  }
  v1::Scene shown = scene;
  if (request.colour) shown.mutable_film()->set_channel(v1::Film::RGB);
  resolve_media(shown);
  // What begins with a dollar is a variable of Mitsuba's.
  std::string stem = path.stem().string();
  std::ranges::replace(stem, '$', '_');
  const MitsubaFiles files = to_mitsuba(shown, media, request.phase, stem);
  const std::filesystem::path folder = path.parent_path();
  for (const MitsubaFiles::Shape& shape : files.shapes) {
    write_file_atomically(folder / shape.file, encode_ply(shape.mesh, shape.corner_normals));
  }
  for (const MitsubaFiles::Picture& picture : files.pictures) {
    write_exr(folder / picture.file, image_of(picture));
  }
  write_file_atomically(path, files.xml);
  return files.not_carried_over;
}

}  // namespace itn
