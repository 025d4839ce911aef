#include "client/dataset/dataset_config.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "client/dataset/distribution.h"
#include "client/image/spectrum.h"
#include "client/presets/presets.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/render_limits.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

v1::DatasetConfig parsed(std::string_view text, const std::string& name) {
  v1::DatasetConfig config;
  parse_text_proto(std::string(text), name, config);
  return config;
}

// Whether it is a group of choices, each of which has a default of its own.
bool is_group(const Message& message) {
  const auto* type = message.GetDescriptor();
  for (int i = 0; i < type->field_count(); ++i) {
    if (type->field(i)->message_type() == v1::Distribution::descriptor()) return true;
  }
  return false;
}

// Removes the default of all that the file has, so that the two can be merged.
void clear_overridden(Message& defaults, const Message& file) {
  std::vector<const FieldDescriptor*> fields;
  file.GetReflection()->ListFields(file, &fields);
  const auto* reflection = defaults.GetReflection();
  for (const FieldDescriptor* field : fields) {
    if (!field->is_repeated() && field->message_type() != nullptr &&
        reflection->HasField(defaults, field) &&
        is_group(reflection->GetMessage(defaults, field))) {
      clear_overridden(*reflection->MutableMessage(&defaults, field),
                       file.GetReflection()->GetMessage(file, field));
    } else {
      reflection->ClearField(&defaults, field);
    }
  }
}

template <typename Choices>
void merge_defaults(Choices& file, Choices defaults) {
  clear_overridden(defaults, file);
  defaults.MergeFrom(file);
  file = std::move(defaults);
}

// --- What is out of range ---

void require_fraction(const char* name, double fraction) {
  require(fraction >= 0 && fraction < 1,
          fmt::format("the {} fraction is {}; it must be in [0, 1)", name, fraction));
}

void require_part(const std::string& name, double part) {
  require(part >= 0 && part <= 1, fmt::format("{} is {}; it must be in [0, 1]", name, part));
}

void validate_samples(const v1::DatasetConfig& config) {
  require(!config.derivatives() || config.has_noise() || config.spp() >= 2,
          "derivatives are estimated from two halves of the samples: spp must be 2 at least");
  if (!config.has_noise()) {
    require(
        config.spp() >= 1 && config.spp() <= kMaxSamples,
        fmt::format("spp is {}; spp must be 1 at least, {} at most", config.spp(), kMaxSamples));
    return;
  }
  const v1::NoiseTarget& noise = config.noise();
  require(!config.has_spp(), "there is a noise target and spp; one of them says how many samples");
  require(noise.target() > 0 && noise.target() <= 1,
          fmt::format("noise.target is {}; it must be in (0, 1]", noise.target()));
  require(
      noise.min_spp() >= 2 && noise.min_spp() <= noise.max_spp() && noise.max_spp() <= kMaxSamples,
      fmt::format("noise.min_spp and max_spp are {} and {}; they must rise, from 2 to {}",
                  noise.min_spp(), noise.max_spp(), kMaxSamples));
  require(noise.pilot_spp() >= 2 && noise.pilot_spp() <= 1024,
          fmt::format("noise.pilot_spp is {}; it must be in [2, 1024]", noise.pilot_spp()));
}

void validate_shapes(const v1::ShapeSource& shapes) {
  constexpr uint32_t kMaxRandomShapes = 1'000'000;
  require(!shapes.has_random() ||
              (shapes.random().count() >= 2 && shapes.random().count() <= kMaxRandomShapes),
          fmt::format("shapes.random.count is {}; it must be in [2, {}]", shapes.random().count(),
                      kMaxRandomShapes));
}

void validate_pose(const v1::PoseChoice& pose) {
  require(pose.upright() >= 0 && pose.turned() >= 0 && pose.any() >= 0 &&
              pose.upright() + pose.turned() + pose.any() > 0 &&
              std::isfinite(pose.upright() + pose.turned() + pose.any()),
          "the weights of pose must be 0 at least, and not all 0");
}

// Lists of azimuths have none in common: turns by 360 degrees are the same illumination.
void require_apart(const v1::SunSkyChoice& sun) {
  if (!sun.has_test_azimuth_degrees() || !is_list(sun.azimuth_degrees()) ||
      !is_list(sun.test_azimuth_degrees())) {
    return;
  }
  const auto wrapped = [](double degrees) { return degrees - 360 * std::floor(degrees / 360); };
  for (const double train : values_of(sun.azimuth_degrees())) {
    for (const double test : values_of(sun.test_azimuth_degrees())) {
      require(wrapped(train) != wrapped(test),
              fmt::format("the sun azimuth {} is in both splits; they must share none", test));
    }
  }
}

constexpr double kMaxAzimuth = 3600;
constexpr double kMinIrradiance = 1e-3, kMaxIrradiance = 1e6;

void validate_sun(const std::string& name, const v1::SunSkyChoice& sun) {
  validate(name + "azimuth_degrees", sun.azimuth_degrees(), -kMaxAzimuth, kMaxAzimuth);
  if (sun.has_test_azimuth_degrees()) {
    validate(name + "test_azimuth_degrees", sun.test_azimuth_degrees(), -kMaxAzimuth, kMaxAzimuth);
  }
  validate(name + "elevation_degrees", sun.elevation_degrees(), 0, 90);
  validate(name + "turbidity", sun.turbidity(), 1, 10);
  validate(name + "sun_angular_radius_degrees", sun.sun_angular_radius_degrees(), 0.1, 45);
  if (sun.has_irradiance()) {
    validate(name + "irradiance", sun.irradiance(), kMinIrradiance, kMaxIrradiance);
  }
  require_apart(sun);
}

// Of a light, which may have none.
void validate_temperature(const std::string& name, const v1::Distribution& temperature) {
  if (temperature.kind_case() == v1::Distribution::KIND_NOT_SET) return;
  validate(name, temperature, kMinTemperature, kMaxTemperature);
}

bool has_temperature(const v1::LightChoice& light) {
  return light.flash().has_temperature() || light.flash().has_ambient_temperature() ||
         light.lamp().has_temperature() || light.lamp().has_ambient_temperature() ||
         light.studio().has_walls_temperature() || light.studio().emitter().has_temperature();
}

void validate_lamp(const std::string& name, const v1::LampChoice& lamp) {
  validate(name + "irradiance", lamp.irradiance(), 0, kMaxIrradiance);
  validate(name + "distance", lamp.distance(), 1, 1000);
  validate(name + "azimuth_degrees", lamp.azimuth_degrees(), -kMaxAzimuth, kMaxAzimuth);
  validate(name + "elevation_degrees", lamp.elevation_degrees(), 0, 90);
  validate(name + "ambient", lamp.ambient(), 0, 10);
  if (lamp.has_radius()) validate(name + "radius", lamp.radius(), 0, 0.3);
  validate_temperature(name + "temperature", lamp.temperature());
  validate_temperature(name + "ambient_temperature", lamp.ambient_temperature());
}

void validate_flash(const std::string& name, const v1::FlashChoice& flash) {
  validate(name + "irradiance", flash.irradiance(), 0, kMaxIrradiance);
  validate(name + "ambient", flash.ambient(), 0, 10);
  validate_temperature(name + "temperature", flash.temperature());
  validate_temperature(name + "ambient_temperature", flash.ambient_temperature());
}

void validate_emitter(const std::string& name, const v1::EmitterChoice& emitter) {
  require_part(name + "lamps", emitter.lamps());
  validate(name + "azimuth_degrees", emitter.azimuth_degrees(), -kMaxAzimuth, kMaxAzimuth);
  validate(name + "elevation_degrees", emitter.elevation_degrees(), 0, 90);
  validate(name + "size_degrees", emitter.size_degrees(), 4, 120);
  validate(name + "aspect", emitter.aspect(), 0.25, 1);
  validate(name + "roll_degrees", emitter.roll_degrees(), -kMaxAzimuth, kMaxAzimuth);
  validate(name + "edge", emitter.edge(), 0, 1);
  validate(name + "strength", emitter.strength(), 1e-3, 1e3);
  validate_temperature(name + "temperature", emitter.temperature());
}

void validate_studio(const std::string& name, const v1::StudioChoice& studio) {
  validate(name + "irradiance", studio.irradiance(), kMinIrradiance, kMaxIrradiance);
  validate(name + "walls", studio.walls(), 0, 1);
  validate(name + "emitters", studio.emitters(), 1, 16);
  require(is_list(studio.emitters()),
          fmt::format("{}emitters is a range; it is a list, one_of, or fixed", name));
  for (const double count : values_of(studio.emitters())) {
    require(count == std::round(count),
            fmt::format("{}emitters is {}; it must be a whole number", name, count));
  }
  validate_emitter(name + "emitter.", studio.emitter());
  validate_temperature(name + "walls_temperature", studio.walls_temperature());
}

void validate_panoramas(const std::string& name, const v1::PanoramaChoice& panoramas) {
  validate(name + "irradiance", panoramas.irradiance(), kMinIrradiance, kMaxIrradiance);
  validate(name + "azimuth_degrees", panoramas.azimuth_degrees(), -kMaxAzimuth, kMaxAzimuth);
}

void validate_light(const std::string& field, const v1::LightChoice& light) {
  require(light.weight() >= 0 && std::isfinite(light.weight()),
          fmt::format("{}.weight is {}; it must be above 0", field, light.weight()));
  switch (light.kind_case()) {
    case v1::LightChoice::kSunSky: return validate_sun(field + ".sun_sky.", light.sun_sky());
    case v1::LightChoice::kFlash: return validate_flash(field + ".flash.", light.flash());
    case v1::LightChoice::kStudio: return validate_studio(field + ".studio.", light.studio());
    case v1::LightChoice::kPanoramas:
      return validate_panoramas(field + ".panoramas.", light.panoramas());
    case v1::LightChoice::kLamp: return validate_lamp(field + ".lamp.", light.lamp());
    case v1::LightChoice::KIND_NOT_SET: break;
  }
  throw invalid_input(fmt::format(
      "{} says no light; it is a sun_sky, a flash, a studio, panoramas or a lamp", field));
}

bool has_pattern(const v1::GroundChoice& ground) {
  return ground.checkered() > 0 || ground.mottled() > 0;
}

void validate_ground(const v1::GroundChoice& ground) {
  require_part("ground.probability", ground.probability());
  validate("reflectance", ground.reflectance(), 0, 1);
  require_part("ground.checkered", ground.checkered());
  require_part("ground.mottled", ground.mottled());
  require_part("ground.coloured", ground.coloured());
  require(ground.checkered() + ground.mottled() <= 1,
          fmt::format("ground.checkered is {} and ground.mottled {}; together they are at most 1",
                      ground.checkered(), ground.mottled()));
  if (has_pattern(ground)) validate("ground.other_reflectance", ground.other_reflectance(), 0, 1);
  if (ground.checkered() > 0) validate("ground.square", ground.square(), 0.01, 20);
  if (ground.mottled() == 0) return;
  validate("ground.image_size", ground.image_size(), 0.1, 100);
  validate("ground.persistence", ground.persistence(), 0, 1);
}

void validate_boundary(const v1::BoundaryChoice& boundary) {
  require_part("boundary.probability", boundary.probability());
  validate("boundary.index", boundary.index(), 1.1, 2.5);
  validate("boundary.roughness", boundary.roughness(), 0.001, 1);
  require(boundary.smooth_angle_degrees() >= 0 && boundary.smooth_angle_degrees() <= 180,
          fmt::format("boundary.smooth_angle_degrees is {}; it must be in [0, 180]",
                      boundary.smooth_angle_degrees()));
}

// 0 where it is what it is.
v1::Distribution irradiance_of(const v1::LightChoice& light) {
  switch (light.kind_case()) {
    case v1::LightChoice::kFlash: return light.flash().irradiance();
    case v1::LightChoice::kStudio: return light.studio().irradiance();
    case v1::LightChoice::kPanoramas: return light.panoramas().irradiance();
    case v1::LightChoice::kLamp: return light.lamp().irradiance();
    default: break;
  }
  return light.sun_sky().has_irradiance() ? light.sun_sky().irradiance() : fixed(0);
}

void validate_colours(const v1::DatasetConfig& config) {
  const v1::ColourChoice& colours = config.materials().colours();
  validate("materials.colours.scattering", colours.scattering(), 0.01, 100);
  validate("materials.colours.absorption", colours.absorption(), 1e-3, 1e3);
  require_part("materials.colours.gray", colours.gray());
  require_part("materials.colours.measured", colours.measured());
  require_part("materials.colours.independent", colours.independent());
  require(colours.gray() + colours.measured() + colours.independent() <= 1,
          fmt::format("materials.colours.gray is {}, measured {} and independent {}; together they "
                      "are at most 1",
                      colours.gray(), colours.measured(), colours.independent()));
  require(
      config.coloured() == 0,
      fmt::format("coloured is {}; images in colour show all of their light", config.coloured()));
  require(!config.derivatives(), "derivatives are of images with one channel, not in colour");
}

void validate_materials(const v1::DatasetConfig& config) {
  const v1::MaterialChoice& materials = config.materials();
  validate("albedo", materials.albedo(), 0, 1);
  validate("g", materials.g(), -kMaxAbsG, kMaxAbsG);
  if (materials.has_sigma_s_reduced()) {
    require(!materials.has_sigma_t(),
            "there are sigma_t and sigma_s_reduced; one of them says how dense media are");
    validate("sigma_s_reduced", materials.sigma_s_reduced(), kMinSigmaT, kMaxSigmaT);
    require(range_of(materials.albedo()).min() > 0,
            "the albedo begins at 0, where nothing scatters; sigma_s_reduced needs one above");
  } else {
    validate("sigma_t", materials.sigma_t(), kMinSigmaT, kMaxSigmaT);
  }
  if (materials.has_colours()) validate_colours(config);
  const v1::Interval sigma_t = material_range(config).sigma_t();
  require(sigma_t.min() >= kMinSigmaT && sigma_t.max() <= kMaxSigmaT,
          fmt::format("materials may have a sigma_t from {} to {}; it must be in [{}, {}]",
                      sigma_t.min(), sigma_t.max(), kMinSigmaT, kMaxSigmaT));
}

void validate_grid(const v1::DatasetConfig& config) {
  const v1::MaterialChoice& materials = config.materials();
  require(is_list(materials.sigma_t()) && is_list(materials.albedo()) && is_list(materials.g()),
          "a grid takes lists of sigma_t, albedo and g: one_of, or fixed");
  const bool one_sun = config.lights_size() == 1 && config.lights(0).has_sun_sky();
  const v1::SunSkyChoice& sun = config.lights(0).sun_sky();
  require(one_sun && is_list(sun.azimuth_degrees()) &&
              (!sun.has_test_azimuth_degrees() || is_list(sun.test_azimuth_degrees())),
          "a grid takes one light, a sun_sky, with lists of azimuths: one_of, or fixed");
  require(config.coloured() == 0,
          fmt::format("coloured is {}; a grid shows luminance", config.coloured()));
  require(config.views() <= 1,
          fmt::format("views is {}; a grid says itself how many images of an object there are",
                      config.views()));
  require(!materials.has_sigma_s_reduced() && !materials.has_colours(),
          "a grid takes sigma_t, and no materials.sigma_s_reduced or colours");
  require(config.count() == 0,
          fmt::format("count is {}; a grid says itself how many images there are", config.count()));
}

}  // namespace

v1::DatasetConfig preset_config(std::string_view name) {
  v1::DatasetConfig config = parsed(find_preset(dataset_presets(), name).file, std::string(name));
  set_defaults(config);
  return config;
}

v1::DatasetConfig paper_config(uint32_t resolution) {
  v1::DatasetConfig config = preset_config("paper");
  config.set_resolution(resolution);
  return config;
}

v1::DatasetConfig load_dataset_config(const std::filesystem::path& path) {
  v1::DatasetConfig config = parsed(read_file(path, "dataset file"), path.string());
  set_defaults(config);
  return config;
}

void set_defaults(v1::DatasetConfig& config) {
  v1::DatasetConfig paper = parsed(find_preset(dataset_presets(), "paper").file, "paper");
  v1::DatasetConfig kinds = parsed(dataset_defaults(), "defaults of datasets");
  // The file decides between settings that exclude each other.
  if (config.has_noise()) paper.clear_spp();
  if (config.materials().sampling() == v1::MaterialChoice::GRID) paper.set_count(0);
  if (config.materials().has_sigma_s_reduced()) paper.mutable_materials()->clear_sigma_t();
  // Each light, if the file has any.
  kinds.mutable_lights()->MergeFrom(paper.lights());
  for (v1::LightChoice& light : *config.mutable_lights()) {
    if (light.weight() == 0) light.set_weight(1);
    const auto of_its_kind =
        std::ranges::find(kinds.lights(), light.kind_case(), &v1::LightChoice::kind_case);
    if (of_its_kind == kinds.lights().end()) continue;
    v1::LightChoice defaults = *of_its_kind;
    // Azimuths are those of the test, too, unless the file says more.
    if (light.sun_sky().has_azimuth_degrees()) {
      defaults.mutable_sun_sky()->clear_test_azimuth_degrees();
    }
    merge_defaults(light, defaults);
  }
  merge_defaults(config, paper);
  // What is absent of these stays so, as in datasets that know nothing of them.
  if (config.has_boundary()) merge_defaults(*config.mutable_boundary(), kinds.boundary());
  if (has_pattern(config.ground())) {
    v1::GroundChoice ground = kinds.ground();
    if (config.ground().checkered() == 0) ground.clear_square();
    if (config.ground().mottled() == 0) {
      ground.clear_image_size();
      ground.clear_persistence();
    }
    merge_defaults(*config.mutable_ground(), ground);
  }
  if (config.has_noise()) merge_defaults(*config.mutable_noise(), kinds.noise());
  if (config.materials().has_colours()) {
    merge_defaults(*config.mutable_materials()->mutable_colours(), kinds.materials().colours());
  }
}

void validate_resolution(uint32_t resolution, const std::string& where) {
  require(
      std::ranges::count(std::array{16U, 32U, 64U, 128U, 256U}, resolution) == 1,
      fmt::format("{}the resolution is {}; it must be 16, 32, 64, 128 or 256", where, resolution));
}

void validate(const v1::DatasetConfig& config) {
  validate_resolution(config.resolution());
  validate_samples(config);
  require(!config.has_views() || (config.views() >= 1 && config.views() <= 64),
          fmt::format("views is {}; it must be in [1, 64]", config.views()));
  require_fraction("test", config.test_fraction());
  require_fraction("validation", config.validation_fraction());
  require(config.test_fraction() + config.validation_fraction() < 1,
          "the fractions of test and validation leave nothing to train with");
  validate_shapes(config.shapes());
  validate_pose(config.pose());
  validate("pitch_degrees", config.camera().pitch_degrees(), 0, 89.9);
  validate("distance", config.camera().distance(), 2, 1000);
  validate("object_size", config.camera().object_size(), 0.05, 2);
  validate("offset", config.camera().offset(), -0.5, 0.5);
  for (int i = 0; i < config.lights_size(); ++i) {
    const std::string name = fmt::format("lights[{}]", i);
    validate_light(name, config.lights(i));
    require(config.materials().has_colours() || !has_temperature(config.lights(i)),
            name + " has a temperature; images have no colours: materials { colours {} }");
  }
  require(std::ranges::count_if(config.lights(), &v1::LightChoice::has_panoramas) <= 1,
          "two lights are panoramas; one can be, of a folder that holds all of them");
  validate_ground(config.ground());
  if (config.has_boundary()) validate_boundary(config.boundary());
  require_part("coloured", config.coloured());
  validate_materials(config);
  if (config.materials().sampling() == v1::MaterialChoice::GRID) validate_grid(config);
}

double common_irradiance(const v1::DatasetConfig& config) {
  v1::Interval all;
  all.set_min(HUGE_VAL);
  for (const v1::LightChoice& light : config.lights()) {
    const v1::Interval one = range_of(irradiance_of(light));
    all.set_min(std::min(all.min(), one.min()));
    all.set_max(std::max(all.max(), one.max()));
  }
  return all.min() == all.max() ? all.min() : 0;
}

v1::MaterialRange material_range(const v1::DatasetConfig& config) {
  const v1::MaterialChoice& materials = config.materials();
  const v1::Interval albedo = range_of(materials.albedo()), g = range_of(materials.g());
  v1::MaterialRange range;
  *range.mutable_albedo() = albedo;
  *range.mutable_g() = g;
  v1::Interval& sigma_t = *range.mutable_sigma_t();
  if (materials.has_sigma_s_reduced()) {
    const v1::Interval reduced = range_of(materials.sigma_s_reduced());
    sigma_t.set_min(reduced.min() / (albedo.max() * (1 - g.min())));
    sigma_t.set_max(reduced.max() / (albedo.min() * (1 - g.max())));
  } else {
    sigma_t = range_of(materials.sigma_t());
  }
  if (materials.has_colours() && materials.colours().independent() < 1) {
    const v1::Interval ratio = range_of(materials.colours().scattering());
    const double albedos = albedo.max() / albedo.min();
    sigma_t.set_min(sigma_t.min() * std::min(1.0, ratio.min()) / albedos);
    sigma_t.set_max(sigma_t.max() * std::max(1.0, ratio.max()) * albedos);
  }
  return range;
}

}  // namespace itn
