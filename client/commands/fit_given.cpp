#include "client/commands/fit_given.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>

#include "client/commands/fit_stand.h"
#include "client/image/image.h"
#include "client/refine/coordinates.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// No light is a point, a spot or of one direction: there is a derivative in the index then.
bool have_size(const v1::Scene& scene) {
  return std::ranges::none_of(scene.lights(), [](const v1::Light& light) {
    return light.has_point() || light.has_spot() ||
           (light.has_directional() && light.directional().angular_radius_degrees() == 0);
  });
}

// What a few steps from several starts, or from the one that is said, find. Writes no files.
Material scouted(RefineOptions refine, v1::Film::Channel channel) {
  refine.channel = channel;
  refine.settings.set_spp(32);
  refine.settings.set_max_spp(64);
  refine.settings.set_max_iterations(8);
  refine.output.clear();
  return from_proto(find_materials(refine).front().material());
}

}  // namespace

void prepare_given_scenes(const FitOptions& options, const fs::path& folder,
                          RefineOptions& refine) {
  refine.scenes = options.scenes;
  refine.mask.clear();  // the images have it
  refine.reading = {};
  refine.settings.set_unknown_exposure(true);
  std::vector<Image> images;
  RefineOptions given = options.refine;
  given.images = options.images;
  given.scenes = options.scenes;
  const std::vector<v1::Scene> scenes = load_scenes(given);
  for (size_t i = 0; i < options.images.size(); ++i) {
    const std::string& name = options.images[i];
    PhotographOptions reading = options.photograph;
    reading.framing = Framing::kObject;
    MarkedPhotograph marked = read_marked(name, reading);
    average_to_film(name, scenes[i], marked.content, marked.mask);
    leave_out_clipped(name, marked.content.file.clipped, marked.mask);
    const std::vector<std::string>& channels = marked.content.channels;
    const bool is_gray = options.luminance || channels.size() == 1;
    refine.channel = is_gray ? v1::Film::LUMINANCE : v1::Film::RGB;
    Image& image = images.emplace_back();
    image.width = marked.content.width();
    image.height = marked.content.height();
    if (is_gray) {
      image.channels["Y"] = radiance_of(marked.content.file.image, channels, v1::Film::LUMINANCE);
    } else {
      for (const std::string& channel : channels) {
        image.channels[channel] = marked.content.file.image.channel(channel);
      }
    }
    image.channels["mask.Y"] = marked.mask;
    allow_for_likeness(marked.mask, image.width, name, options.shape_error, refine);
    const fs::path file = photograph_file(folder, options, i);
    write_exr(file, image);
    refine.images.push_back(file.string());
  }
  const v1::Object& object = scenes.front().object();
  if (object.has_rough_dielectric()) {
    refine.settings.add_unknowns(kRoughness);
    if (options.index_error > 0 && !std::ranges::all_of(scenes, have_size)) {
      spdlog::warn(
          "the index of refraction stays that of the scene, as it has a light without a size; "
          "sphere { center { ... } radius: 2 } instead of a point lets it be found");
    } else if (options.index_error > 0) {
      refine.settings.add_unknowns(kIndex);
      (*refine.settings.mutable_known_within())[kIndex] = options.index_error;
    }
  }
  std::vector<Material> materials{scouted(refine, v1::Film::LUMINANCE)};
  const auto start_from = [](const Material& start, RefineOptions& refined) {
    refined.init = fmt::format("{},{},{}", start.sigma_t, start.albedo, start.g);
    refined.starts = 1;
  };
  if (options.refine.init == "mean") {
    start_from(of_similar_light(materials.front(), options.g), refine);
  }
  if (refine.channel == v1::Film::RGB) {
    RefineOptions of_colour = refine;
    start_from(materials.front(), of_colour);
    materials.clear();
    for (const v1::Film::Channel colour : kColours) {
      materials.push_back(scouted(of_colour, colour));
    }
  }
  RenderPool pool(options.refine.workers.pool_options());
  for (size_t i = 0; i < images.size(); ++i) {
    add_disturbances(
        disturbances_of_g(scenes[i], materials, images[i].channel("mask.Y"), options, pool),
        images[i]);
    write_exr(refine.images[i], images[i]);
  }
}

}  // namespace itn
