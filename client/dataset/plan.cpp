#include "client/dataset/plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/choices.h"
#include "client/dataset/colour_media.h"
#include "client/dataset/distribution.h"
#include "client/dataset/item_scene.h"
#include "common/error.h"
#include "common/random.h"
#include "common/scene/material_proto.h"
#include "server/renderer.h"

namespace itn {
namespace {

// Draws the material, which in colour is that of green.
Material draw_material(const v1::MaterialChoice& materials, const Choices& choices) {
  std::array<double, 3> u = choices.point(kMaterial);
  if (materials.sampling() == v1::MaterialChoice::RANDOM) {
    SplitMix random = choices.random(kMaterial);
    for (double& number : u) number = random.uniform();
  }
  return medium_of(materials, quantile(density_of(materials), u[0]),
                   quantile(materials.albedo(), u[1]), quantile(materials.g(), u[2]));
}

v1::Rotation axis_rotation(double x, double y, double z, double degrees) {
  v1::Rotation rotation;
  rotation.mutable_axis()->set_x(static_cast<float>(x));
  rotation.mutable_axis()->set_y(static_cast<float>(y));
  rotation.mutable_axis()->set_z(static_cast<float>(z));
  rotation.set_angle_degrees(static_cast<float>(degrees));
  return rotation;
}

// A unit quaternion, every one as likely (Shoemake, "Uniform random rotations", Graphics Gems III).
v1::Rotation any_rotation(const std::array<double, 3>& u) {
  constexpr double kTurn = 2 * std::numbers::pi;
  const double a = std::sqrt(1 - u[0]), b = std::sqrt(u[0]);
  const double w = b * std::cos(kTurn * u[2]);
  return axis_rotation(a * std::sin(kTurn * u[1]), a * std::cos(kTurn * u[1]),
                       b * std::sin(kTurn * u[2]),
                       2 * std::acos(std::clamp(w, -1.0, 1.0)) * 180 / std::numbers::pi);
}

void draw_pose(const v1::PoseChoice& pose, const Choices& choices, v1::DatasetItem& item) {
  const double weights[] = {pose.upright(), pose.turned(), pose.any()};
  const auto u = [&](uint64_t axis) { return choices.number(derive_seed(kRotation, {axis})); };
  switch (weighted(weights, choices.number(kPoseKind))) {
    case 0: return;
    case 1: *item.mutable_rotation() = axis_rotation(0, 1, 0, 360 * u(0)); return;
    default: *item.mutable_rotation() = any_rotation({u(0), u(1), u(2)});
  }
}

v1::ItemCamera draw_camera(const v1::CameraChoice& camera, const Choices& choices) {
  v1::ItemCamera item;
  item.set_pitch_degrees(choices.draw(kPitch, camera.pitch_degrees()));
  item.set_distance(choices.draw(kDistance, camera.distance()));
  item.set_object_size(choices.draw(kObjectSize, camera.object_size()));
  item.set_offset_x(choices.draw(kOffsetX, camera.offset()));
  item.set_offset_y(choices.draw(kOffsetY, camera.offset()));
  return item;
}

const v1::Distribution& azimuths_of(const v1::SunSkyChoice& sun, v1::Split split) {
  return split == v1::SPLIT_TEST && sun.has_test_azimuth_degrees() ? sun.test_azimuth_degrees()
                                                                   : sun.azimuth_degrees();
}

// Makes what a film shows of sun and sky so bright; in colour, its luminance.
void give_irradiance(v1::SunSky& sun, float irradiance, v1::Film::Channel channel) {
  const double unscaled =
      irradiance_from_above(sun, channel == v1::Film::RGB ? v1::Film::LUMINANCE : channel);
  sun.set_sun_scale(static_cast<float>(irradiance / unscaled));
  sun.set_sky_scale(static_cast<float>(irradiance / unscaled));
}

// The choices of one light are branches of its own.
v1::SunSky draw_sun(const v1::SunSkyChoice& choice, v1::Split split, v1::Film::Channel channel,
                    uint64_t light, const Choices& choices) {
  const auto draw = [&](uint64_t number, const v1::Distribution& distribution) {
    return choices.draw(derive_seed(kLight, {light, number}), distribution);
  };
  v1::SunSky sun;
  sun.set_sun_azimuth_degrees(draw(0, azimuths_of(choice, split)));
  sun.set_sun_elevation_degrees(draw(1, choice.elevation_degrees()));
  sun.set_turbidity(draw(2, choice.turbidity()));
  sun.set_sun_angular_radius_degrees(draw(3, choice.sun_angular_radius_degrees()));
  if (choice.has_irradiance()) give_irradiance(sun, draw(4, choice.irradiance()), channel);
  return sun;
}

// The colours of a lamp, or of a flash, and of the room about it.
template <typename Choice, typename Light>
void draw_temperatures(const Choice& choice, uint64_t light, const Choices& choices, Light& drawn) {
  const auto branch = [&](uint64_t number) {
    return derive_seed(kLight, {light, kTemperature, number});
  };
  if (choice.has_temperature()) {
    drawn.set_temperature(choices.draw(branch(0), choice.temperature()));
  }
  if (choice.has_ambient_temperature()) {
    drawn.set_ambient_temperature(choices.draw(branch(1), choice.ambient_temperature()));
  }
}

v1::Flash draw_flash(const v1::FlashChoice& choice, uint64_t light, const Choices& choices) {
  v1::Flash flash;
  flash.set_irradiance(choices.draw(derive_seed(kLight, {light, 0}), choice.irradiance()));
  flash.set_ambient(choices.draw(derive_seed(kLight, {light, 1}), choice.ambient()));
  draw_temperatures(choice, light, choices, flash);
  return flash;
}

// `branch`: of this emitter's choices.
v1::Emitter draw_emitter(const v1::EmitterChoice& choice, uint64_t branch, const Choices& choices) {
  const auto draw = [&](uint64_t number, const v1::Distribution& distribution) {
    return choices.draw(derive_seed(branch, {number}), distribution);
  };
  v1::Emitter emitter;
  emitter.set_is_lamp(choices.number(derive_seed(branch, {0})) < choice.lamps());
  emitter.set_azimuth_degrees(draw(1, choice.azimuth_degrees()));
  emitter.set_elevation_degrees(draw(2, choice.elevation_degrees()));
  emitter.set_size_degrees(draw(3, choice.size_degrees()));
  emitter.set_edge(draw(4, choice.edge()));
  emitter.set_strength(draw(5, choice.strength()));
  if (!emitter.is_lamp()) {
    emitter.set_aspect(draw(6, choice.aspect()));
    emitter.set_roll_degrees(draw(7, choice.roll_degrees()));
  }
  if (choice.has_temperature()) emitter.set_temperature(draw(8, choice.temperature()));
  return emitter;
}

v1::Studio draw_studio(const v1::StudioChoice& choice, uint64_t light, const Choices& choices) {
  const auto branch = [&](uint64_t number) { return derive_seed(kLight, {light, number}); };
  v1::Studio studio;
  studio.set_irradiance(choices.draw(branch(0), choice.irradiance()));
  studio.set_walls(choices.draw(branch(1), choice.walls()));
  const auto emitters =
      static_cast<uint64_t>(std::lround(choices.draw(branch(2), choice.emitters())));
  for (uint64_t i = 0; i < emitters; ++i) {
    *studio.add_emitters() = draw_emitter(choice.emitter(), branch(3 + i), choices);
  }
  if (choice.has_walls_temperature()) {
    studio.set_walls_temperature(choices.draw(branch(kTemperature), choice.walls_temperature()));
  }
  return studio;
}

v1::Panorama draw_panorama(const v1::PanoramaChoice& choice, const std::vector<std::string>& names,
                           uint64_t light, const Choices& choices) {
  const auto branch = [&](uint64_t number) { return derive_seed(kLight, {light, number}); };
  v1::Panorama panorama;
  panorama.set_name(names.at(choices.in_turn(branch(0), names.size())));
  panorama.set_irradiance(choices.draw(branch(1), choice.irradiance()));
  panorama.set_azimuth_degrees(choices.draw(branch(2), choice.azimuth_degrees()));
  return panorama;
}

v1::Lamp draw_lamp_once(const v1::LampChoice& choice, uint64_t light, uint64_t attempt,
                        const Choices& choices) {
  const auto draw = [&](uint64_t number, const v1::Distribution& distribution) {
    return choices.draw(attempt == 0 ? derive_seed(kLight, {light, number})
                                     : derive_seed(kLight, {light, number, attempt}),
                        distribution);
  };
  v1::Lamp lamp;
  lamp.set_irradiance(draw(0, choice.irradiance()));
  lamp.set_distance(draw(1, choice.distance()));
  lamp.set_azimuth_degrees(draw(2, choice.azimuth_degrees()));
  lamp.set_elevation_degrees(draw(3, choice.elevation_degrees()));
  lamp.set_ambient(draw(4, choice.ambient()));
  if (choice.has_radius()) lamp.set_radius(draw(5, choice.radius()));
  return lamp;
}

v1::Lamp draw_lamp(const v1::LampChoice& choice, const v1::ItemCamera& camera, uint64_t light,
                   const Choices& choices) {
  constexpr uint64_t kAttempts = 100;
  for (uint64_t attempt = 0; attempt < kAttempts; ++attempt) {
    v1::Lamp lamp = draw_lamp_once(choice, light, attempt, choices);
    if (lamp.radius() == 0 || !may_be_seen(lamp, camera)) {
      draw_temperatures(choice, light, choices, lamp);
      return lamp;
    }
  }
  throw invalid_input(fmt::format(
      "lights[{}].lamp stands in the picture, {} times of {}: choose other directions or distances",
      light, kAttempts, kAttempts));
}

v1::ItemLight draw_light(const v1::DatasetConfig& config, v1::Split split,
                         const v1::DatasetItem& item_so_far, const NameSplit& panoramas,
                         const Choices& choices) {
  std::vector<double> weights;
  for (const v1::LightChoice& light : config.lights()) weights.push_back(light.weight());
  const size_t kind = weighted(weights, choices.number(kLightKind));
  const v1::LightChoice& light = config.lights(static_cast<int>(kind));
  v1::ItemLight item;
  switch (light.kind_case()) {
    case v1::LightChoice::kFlash:
      *item.mutable_flash() = draw_flash(light.flash(), kind, choices);
      break;
    case v1::LightChoice::kStudio:
      *item.mutable_studio() = draw_studio(light.studio(), kind, choices);
      break;
    case v1::LightChoice::kPanoramas:
      *item.mutable_panorama() =
          draw_panorama(light.panoramas(), panoramas.names_or_training(split), kind, choices);
      break;
    case v1::LightChoice::kLamp:
      *item.mutable_lamp() = draw_lamp(light.lamp(), item_so_far.camera(), kind, choices);
      break;
    default:
      *item.mutable_sun_sky() =
          draw_sun(light.sun_sky(), split, item_so_far.channel(), kind, choices);
  }
  return item;
}

// Squares that are turned about the origin.
v1::Checkerboard draw_checkerboard(const v1::GroundChoice& ground, const Choices& choices) {
  const auto branch = [](uint64_t number) { return derive_seed(kCheckerboard, {number}); };
  const float side = choices.draw(branch(1), ground.square());
  const double turn = 2 * std::numbers::pi * choices.number(branch(2));
  const auto u = static_cast<float>(std::cos(turn)), v = static_cast<float>(std::sin(turn));
  v1::Checkerboard board;
  board.set_even(choices.draw(kReflectance, ground.reflectance()));
  board.set_odd(choices.draw(branch(3), ground.other_reflectance()));
  board.mutable_edge_u()->set_x(side * u);
  board.mutable_edge_u()->set_z(side * v);
  board.mutable_edge_v()->set_x(-side * v);
  board.mutable_edge_v()->set_z(side * u);
  return board;
}

// Draws a texture's seed, shape and colours.
v1::GroundTexture draw_texture(const v1::GroundChoice& ground, const Choices& choices) {
  const auto branch = [](uint64_t number) { return derive_seed(kTexture, {number}); };
  v1::GroundTexture texture;
  texture.set_seed(choices.random(branch(0)).next());
  texture.set_reflectance(choices.draw(kReflectance, ground.reflectance()));
  texture.set_other_reflectance(choices.draw(branch(1), ground.other_reflectance()));
  texture.set_image_size(choices.draw(branch(2), ground.image_size()));
  texture.set_turn_degrees(static_cast<float>(360 * choices.number(branch(3))));
  texture.set_persistence(choices.draw(branch(4), ground.persistence()));
  return texture;
}

v1::ColorReflectance draw_ground_color(const v1::GroundChoice& ground, const Choices& choices) {
  const auto branch = [](uint64_t number) { return derive_seed(kGroundColor, {number}); };
  v1::ColorReflectance color;
  color.set_red(choices.draw(branch(1), ground.reflectance()));
  color.set_green(choices.draw(kReflectance, ground.reflectance()));
  color.set_blue(choices.draw(branch(2), ground.reflectance()));
  return color;
}

void draw_ground(const v1::GroundChoice& ground, const Choices& choices, v1::DatasetItem& item) {
  if (choices.number(kGround) >= ground.probability()) return;
  const double pattern = choices.number(derive_seed(kCheckerboard, {0}));
  if (pattern < ground.checkered()) {
    *item.mutable_ground_checkerboard() = draw_checkerboard(ground, choices);
  } else if (pattern < ground.checkered() + ground.mottled()) {
    *item.mutable_ground_texture() = draw_texture(ground, choices);
  } else if (choices.number(derive_seed(kGroundColor, {0})) < ground.coloured()) {
    *item.mutable_ground_color() = draw_ground_color(ground, choices);
  } else {
    item.set_ground_reflectance(choices.draw(kReflectance, ground.reflectance()));
  }
}

void draw_boundary(const v1::BoundaryChoice& choice, const Choices& choices,
                   v1::DatasetItem& item) {
  const auto branch = [](uint64_t number) { return derive_seed(kBoundary, {number}); };
  if (choices.number(branch(0)) >= choice.probability()) return;
  item.mutable_boundary()->set_index(choices.draw(branch(1), choice.index()));
  item.mutable_boundary()->set_roughness(choices.draw(branch(2), choice.roughness()));
  item.set_smooth_angle_degrees(choice.smooth_angle_degrees());
}

v1::Film::Channel draw_channel(const v1::DatasetConfig& config, const Choices& choices) {
  if (config.materials().has_colours()) return v1::Film::RGB;
  if (choices.number(derive_seed(kChannel, {0})) >= config.coloured()) return v1::Film::LUMINANCE;
  constexpr std::array kColours = {v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE};
  return kColours.at(choices.in_turn(derive_seed(kChannel, {1}), kColours.size()));
}

uint64_t views_of(const v1::DatasetConfig& config) {
  return std::max(1U, config.views());
}

// All but the material; and the seed and the name, which are the item's own. `of_object`: the
// choices of what all views of an object share.
v1::DatasetItem draw_scene(const v1::DatasetConfig& config, v1::Split split,
                           const std::string& shape, const NameSplit& panoramas,
                           const Choices& of_object, const Choices& choices) {
  v1::DatasetItem item;
  item.set_split(split);
  item.set_shape(shape);
  draw_pose(config.pose(), choices, item);
  *item.mutable_camera() = draw_camera(config.camera(), choices);
  item.set_channel(draw_channel(config, choices));
  *item.mutable_light() = draw_light(config, split, item, panoramas, choices);
  draw_ground(config.ground(), choices, item);
  if (config.has_boundary()) draw_boundary(config.boundary(), of_object, item);
  return item;
}

void set_number(v1::DatasetItem& item, const v1::DatasetConfig& config, uint64_t index) {
  item.set_file(fmt::format("images/{:06}.exr", index));
  item.set_seed(derive_seed(config.seed(), {kRenderSeed, index}));
}

// --- Grids ---

std::vector<v1::Material> grid_materials(const v1::MaterialChoice& choice) {
  std::vector<v1::Material> materials;
  for (const double sigma_t : values_of(choice.sigma_t())) {
    for (const double albedo : values_of(choice.albedo())) {
      for (const double g : values_of(choice.g())) {
        materials.push_back(to_proto({sigma_t, albedo, g}));
      }
    }
  }
  return materials;
}

// Every material with every azimuth and shape. What else is drawn is the same for all materials.
void add_grid(v1::Dataset& manifest, v1::Split split, const std::vector<std::string>& shapes) {
  const v1::DatasetConfig& config = manifest.config();
  const std::vector<v1::Material> materials = grid_materials(config.materials());
  const std::vector<double> azimuths = values_of(azimuths_of(config.lights(0).sun_sky(), split));
  uint64_t scene = 0;
  for (const std::string& shape : shapes) {
    for (const double azimuth : azimuths) {
      const Choices choices(config, {split, scene++});
      v1::DatasetItem item = draw_scene(config, split, shape, {}, choices, choices);
      item.mutable_light()->mutable_sun_sky()->set_sun_azimuth_degrees(static_cast<float>(azimuth));
      for (const v1::Material& material : materials) {
        *item.mutable_material() = material;
        set_number(item, config, static_cast<uint64_t>(manifest.items_size()));
        *manifest.add_items() = item;
      }
    }
  }
}

// --- Datasets ---

// A file of the dataset, which is written when it is rendered. `entry`: a message of the manifest.
template <typename Entry, typename Part>
void add_file(DatasetPlan& plan, const Part& part, v1::Split split, const std::string& file,
              Entry& entry) {
  entry.set_name(part.name);
  entry.set_split(split);
  entry.set_file(file);
  entry.set_sha256(part.sha256);
  if (part.to_file) plan.files[file] = part.to_file;
}

void add_shape(DatasetPlan& plan, const Shape& shape, v1::Split split) {
  add_file(plan, shape, split, fmt::format("shapes/{}.mesh", shape.name),
           *plan.manifest.add_shapes());
}

void add_panorama(DatasetPlan& plan, const Panorama& panorama, v1::Split split) {
  add_file(plan, panorama, split, fmt::format("panoramas/{}.map", panorama.name),
           *plan.manifest.add_panoramas());
}

bool is_grid(const v1::DatasetConfig& config) {
  return config.materials().sampling() == v1::MaterialChoice::GRID;
}

// They may move; what is in them stays with the dataset.
void forget_folders(v1::DatasetConfig& config) {
  if (config.shapes().has_folder()) config.mutable_shapes()->mutable_folder()->clear_path();
  for (v1::LightChoice& light : *config.mutable_lights()) {
    if (light.has_panoramas()) light.mutable_panoramas()->clear_folder();
  }
}

void add_items(v1::Dataset& manifest, const NameSplit& shapes, const NameSplit& panoramas) {
  const v1::DatasetConfig& config = manifest.config();
  manifest.mutable_items()->Reserve(static_cast<int>(config.count()));
  for (auto i = static_cast<uint64_t>(manifest.items_size()); i < config.count(); ++i) {
    *manifest.add_items() = plan_item(config, shapes, i, panoramas);
  }
}

}  // namespace

v1::DatasetItem plan_item(const v1::DatasetConfig& config, const NameSplit& shapes, uint64_t index,
                          const NameSplit& panoramas) {
  const uint64_t views = views_of(config);
  const ItemPlace place = place_of(config, index / views);
  const Choices of_object(config, place);
  const Choices choices(config, {place.split, place.index * views + index % views});
  const std::vector<std::string>& names = shapes.names(place.split);
  v1::DatasetItem item =
      draw_scene(config, place.split, names.at(of_object.in_turn(kShape, names.size())), panoramas,
                 of_object, choices);
  const Material material = draw_material(config.materials(), of_object);
  if (config.materials().has_colours()) {
    for (const Material& colour : draw_colours(config.materials(), material, of_object)) {
      *item.add_colours() = to_proto(colour);
    }
  } else {
    *item.mutable_material() = to_proto(material);
  }
  set_number(item, config, index);
  return item;
}

DatasetPlan plan_dataset(const v1::DatasetConfig& config, std::span<const Shape> shapes,
                         std::span<const Panorama> panoramas) {
  validate(config);
  require(config.test_fraction() > 0,
          "the test fraction is 0; it must be in (0, 1), as a dataset is tested with");
  DatasetPlan plan;
  *plan.manifest.mutable_config() = config;
  forget_folders(*plan.manifest.mutable_config());
  // Split the shapes and the panoramas.
  const NameSplit split = split_shapes(config, shapes);
  for (const Shape& shape : shapes) add_shape(plan, shape, split.split_of(shape.name));
  const NameSplit panorama_split = split_panoramas(config, panoramas);
  for (const Panorama& panorama : panoramas) {
    add_panorama(plan, panorama, panorama_split.split_of(panorama.name));
  }
  // Choose the items.
  if (is_grid(config)) {
    for (const v1::Split part : {v1::SPLIT_TRAIN, v1::SPLIT_VALIDATION, v1::SPLIT_TEST}) {
      add_grid(plan.manifest, part, split.names(part));
    }
    return plan;
  }
  const uint64_t views = views_of(config);
  const uint64_t objects = (config.count() + views - 1) / views;
  const uint64_t test = part_of(config.test_fraction(), objects);
  require(test >= 1 && test < objects,
          fmt::format("of {} {}, with a test fraction of {}, {} are to test with; training "
                      "and test need one each at least: choose more images, or another fraction",
                      objects, views > 1 ? "objects" : "images", config.test_fraction(), test));
  add_items(plan.manifest, split, panorama_split);
  return plan;
}

DatasetPlan extended(const v1::Dataset& existing, uint32_t count) {
  const v1::DatasetConfig& config = existing.config();
  require(!is_grid(config), "a grid of materials is complete as it is; it takes no count");
  require(count >= config.count(),
          fmt::format("there are {} images already, and {} are asked for; images can be added, not "
                      "taken away: choose another folder",
                      config.count(), count));
  DatasetPlan plan{existing, {}};
  plan.manifest.mutable_config()->set_count(count);
  add_items(plan.manifest, split_shapes(existing), split_panoramas(existing));
  return plan;
}

}  // namespace itn
