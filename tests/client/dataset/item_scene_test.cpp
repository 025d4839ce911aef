#include "client/dataset/item_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "client/dataset/ground_texture.h"
#include "client/dataset/panorama.h"
#include "client/dataset/plan.h"
#include "client/image/spectrum.h"
#include "client/render_pool/render_pool.h"
#include "common/geometry/mesh.h"
#include "common/scene/mesh_builder.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"
#include "tests/client/dataset/dataset_support.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

v1::Triangles triangles_of(const char* shape) {
  v1::Mesh proto;
  set_triangles(proto, make_shape(shape));
  return proto.triangles();
}

Mesh object_of(const v1::Scene& scene) {
  return MeshBuilder(1 << 20).build("object.mesh", scene.object().mesh());
}

v1::DatasetItem upright_item() {
  v1::DatasetItem item;
  item.mutable_camera()->set_pitch_degrees(20);
  item.mutable_camera()->set_distance(10);
  item.mutable_camera()->set_object_size(0.5F);
  item.mutable_light()->mutable_sun_sky()->set_sun_azimuth_degrees(70);
  item.set_ground_reflectance(0.25F);
  return item;
}

TEST(ItemScene, StandsOnTheGroundHoweverItIsTurned) {
  const v1::Triangles triangles = triangles_of("figure");
  v1::DatasetConfig config = preset_config("outdoor");
  config.mutable_pose()->Clear();
  config.mutable_pose()->set_any(1);
  const NameSplit shapes{{"figure"}, {"figure"}, {"figure"}};
  const double height = bounds(make_shape("figure")).max.y;
  for (uint64_t i = 0; i < 20; ++i) {
    const v1::DatasetItem item = plan_item(config, shapes, i);
    const Mesh mesh = object_of(scene_of(item, triangles, 64));
    EXPECT_NEAR(bounds(mesh).min.y, 0, 1e-5) << i;
    EXPECT_NEAR(signed_volume(mesh), signed_volume(make_shape("figure")), 1e-5) << i;
    // The middle of its box goes with it, and the camera looks there.
    const v1::Scene scene = scene_of(item, triangles, 64);
    const v1::Vec3& middle = scene.object().mesh().transforms(2).translate();
    EXPECT_EQ(middle.x(), 0);
    EXPECT_GT(middle.y(), 0.05);
    EXPECT_LT(middle.y(), 1);
    const double frame = 1 / item.camera().object_size();
    const double miss = std::hypot(item.camera().offset_x(), item.camera().offset_y()) * frame;
    const Vec3d target{scene.camera().target().x(), scene.camera().target().y(),
                       scene.camera().target().z()};
    EXPECT_NEAR(length(target - Vec3d{0, middle.y(), 0}), miss, 1e-5);
  }
  v1::DatasetItem turned = upright_item();
  turned.mutable_rotation()->mutable_axis()->set_y(1);
  turned.mutable_rotation()->set_angle_degrees(90);
  const Mesh mesh = object_of(scene_of(turned, triangles, 64));
  const Mesh before = make_shape("figure");
  EXPECT_NEAR(bounds(mesh).max.y, height, 1e-6);
  EXPECT_NEAR(mesh.vertices[5].x, before.vertices[5].z, 1e-6);  // counter-clockwise from above
}

TEST(ItemScene, AMillimetreTakesItsPartOfTheFrame) {
  v1::DatasetItem item = upright_item();
  const v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  const v1::Camera& camera = scene.camera();
  EXPECT_FLOAT_EQ(camera.target().y(), 0.5F);
  EXPECT_NEAR(camera.origin().y(), 0.5 + 10 * std::sin(20 * std::numbers::pi / 180), 1e-5);
  EXPECT_NEAR(camera.origin().z(), -10 * std::cos(20 * std::numbers::pi / 180), 1e-5);
  EXPECT_NEAR(2 * 10 * std::tan(camera.fov_degrees() / 2 * std::numbers::pi / 180), 2, 1e-5);
  EXPECT_EQ(scene.surfaces(0).reflectance(), 0.25F);
  EXPECT_EQ(scene.lights(0).sun_sky().sun_azimuth_degrees(), 70);
  EXPECT_EQ(scene.film().width(), 64);
  item.clear_ground_reflectance();
  EXPECT_EQ(scene_of(item, triangles_of("cube"), 64).surfaces_size(), 0);
}

TEST(ItemScene, AFlashIsWhereTheCameraIs) {
  v1::DatasetItem item = upright_item();
  item.mutable_light()->mutable_flash()->set_irradiance(50);
  v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  ASSERT_EQ(scene.lights_size(), 1);
  const v1::DirectionalLight& flash = scene.lights(0).directional();
  EXPECT_EQ(flash.irradiance(), 50);
  const v1::Camera& camera = scene.camera();
  EXPECT_NEAR(flash.direction().y(), (camera.origin().y() - camera.target().y()) / 10, 1e-5);
  EXPECT_NEAR(flash.direction().z(), (camera.origin().z() - camera.target().z()) / 10, 1e-5);
  item.mutable_light()->mutable_flash()->set_ambient(0.1F);
  scene = scene_of(item, triangles_of("cube"), 64);
  ASSERT_EQ(scene.lights_size(), 2);
  EXPECT_NEAR(scene.lights(1).constant().radiance(), 5 / std::numbers::pi, 1e-5);
}

// A lamp of 8 W/m^2 at 5 mm: 8 (0.005)^2 W/sr, from the middle of the object.
TEST(ItemScene, ALampStandsAboutTheMiddle) {
  v1::DatasetItem item = upright_item();
  v1::Lamp& lamp = *item.mutable_light()->mutable_lamp();
  lamp.set_irradiance(8);
  lamp.set_distance(5);
  lamp.set_azimuth_degrees(90);
  lamp.set_elevation_degrees(30);
  lamp.set_ambient(0.5F);
  const v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  ASSERT_EQ(scene.lights_size(), 2);
  const v1::PointLight& light = scene.lights(0).point();
  EXPECT_NEAR(light.position().x(), 5 * std::sqrt(0.75), 1e-5);
  EXPECT_NEAR(light.position().y(), 0.5 + 2.5, 1e-5);
  EXPECT_NEAR(light.position().z(), 0, 1e-5);
  EXPECT_NEAR(light.intensity(), 2e-4, 1e-9);
  EXPECT_NEAR(scene.lights(1).constant().radiance(), 4 / std::numbers::pi, 1e-5);
}

// A ball of the same irradiance there: pi radiance (radius / distance)^2.
TEST(ItemScene, ALampMayHaveASize) {
  v1::DatasetItem item = upright_item();
  v1::Lamp& lamp = *item.mutable_light()->mutable_lamp();
  lamp.set_irradiance(8);
  lamp.set_distance(5);
  lamp.set_elevation_degrees(90);
  lamp.set_radius(0.2F);
  const v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  ASSERT_EQ(scene.lights_size(), 1);
  const v1::SphereLight& light = scene.lights(0).sphere();
  EXPECT_NEAR(light.center().y(), 5.5, 1e-5);
  EXPECT_NEAR(light.radius(), 1, 1e-6);
  EXPECT_NEAR(light.radiance(), 8 / (std::numbers::pi * 0.04), 1e-3);
}

// None is in a picture that may not be, and many that may be are: they are brighter than all else
// that is there.
TEST(ItemScene, KnowsWhichLampsStandInThePicture) {
  RenderPool pool({});
  v1::DatasetItem item = upright_item();
  item.mutable_camera()->set_offset_x(0.1F);
  v1::Lamp& lamp = *item.mutable_light()->mutable_lamp();
  lamp.set_irradiance(8);
  int possible = 0, seen = 0;
  for (int i = 0; i < 300; ++i) {
    lamp.set_azimuth_degrees(static_cast<float>(i * 37 % 360));
    lamp.set_elevation_degrees(static_cast<float>(i % 61));
    lamp.set_distance(1.5F + static_cast<float>(i % 17));
    lamp.set_radius(i % 2 == 0 ? 0.1F : 0.2F);
    RenderJob job{serialize(scene_of(item, triangles_of("cube"), 16)), {}};
    job.request.mutable_material()->set_sigma_t(10);
    job.request.set_spp(1);
    const v1::RenderGradReply reply = pool.submit(job).get();
    const bool shines = std::ranges::max(from_bytes<float>(reply.estimates(0).radiance())) > 50;
    if (may_be_seen(lamp, item.camera())) {
      ++possible;
      seen += shines ? 1 : 0;
    } else {
      EXPECT_FALSE(shines) << i;
    }
  }
  EXPECT_GT(possible, 30);
  EXPECT_GT(seen, possible / 4);
}

// A panorama of luminance 1, whose green is half as bright above the horizon and blue is dark
// there.
TEST(ItemScene, ShowsAColourOfThePanoramaAsBrightAsAsked) {
  v1::DatasetItem item = upright_item();
  v1::Panorama& panorama = *item.mutable_light()->mutable_panorama();
  panorama.set_name("dusk");
  panorama.set_irradiance(30);
  v1::Pixels pixels;
  pixels.set_width(2);
  pixels.set_height(2);
  std::vector<float> rgb;
  const auto above = static_cast<float>(1 / std::numbers::pi);
  for (int i = 0; i < 2; ++i) rgb.insert(rgb.end(), {3 * above, above / 2, 0});
  for (int i = 0; i < 2; ++i) rgb.insert(rgb.end(), {0, 0, 1});
  pixels.set_rgb(to_bytes(rgb));
  const auto scale_in = [&](v1::Film::Channel channel) {
    item.set_channel(channel);
    const v1::Scene scene = scene_of(item, triangles_of("cube"), 64, &pixels);
    EXPECT_EQ(scene.film().channel(), channel);
    return scene.lights(0).environment_map().scale();
  };
  EXPECT_EQ(scale_in(v1::Film::LUMINANCE), 30);
  EXPECT_NEAR(scale_in(v1::Film::RED), 10, 1e-4);
  EXPECT_NEAR(scale_in(v1::Film::GREEN), 60, 1e-3);
  testing::expect_error(ErrorKind::kInvalidInput,
                        {"the panorama dusk is black above the horizon in BLUE"},
                        [&] { scale_in(v1::Film::BLUE); });
}

TEST(ItemScene, HasTheSurfaceAndTheGroundOfTheItem) {
  v1::DatasetItem item = upright_item();
  item.mutable_boundary()->set_index(1.4F);
  item.mutable_boundary()->set_roughness(0.3F);
  item.set_smooth_angle_degrees(40);
  item.clear_ground_reflectance();
  item.mutable_ground_checkerboard()->set_odd(0.7F);
  const v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  EXPECT_EQ(scene.object().rough_dielectric().index(), 1.4F);
  EXPECT_EQ(scene.object().rough_dielectric().roughness(), 0.3F);
  EXPECT_EQ(scene.object().smooth_angle_degrees(), 40);
  ASSERT_EQ(scene.surfaces_size(), 1);
  EXPECT_EQ(scene.surfaces(0).checkerboard().odd(), 0.7F);
  EXPECT_FALSE(scene.surfaces(0).has_reflectance());
}

TEST(ItemScene, HasTheColourOfTheGround) {
  v1::DatasetItem item = upright_item();
  item.clear_ground_reflectance();
  item.mutable_ground_color()->set_blue(0.7F);
  const v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  ASSERT_EQ(scene.surfaces_size(), 1);
  EXPECT_EQ(scene.surfaces(0).color().blue(), 0.7F);
}

v1::GroundTexture texture_of(uint64_t seed, float persistence) {
  v1::GroundTexture texture;
  texture.set_seed(seed);
  texture.set_reflectance(0.6F);
  texture.set_other_reflectance(0.1F);
  texture.set_image_size(3);
  texture.set_turn_degrees(90);
  texture.set_persistence(persistence);
  return texture;
}

TEST(ItemScene, HasTheMottledGroundOfTheItem) {
  v1::DatasetItem item = upright_item();
  item.clear_ground_reflectance();
  *item.mutable_ground_texture() = texture_of(3, 0.5F);
  const v1::Scene scene = scene_of(item, triangles_of("cube"), 64);
  ASSERT_EQ(scene.surfaces_size(), 1);
  const v1::ImageReflectance& image = scene.surfaces(0).image();
  EXPECT_NEAR(image.edge_u().z(), 3, 1e-6);
  EXPECT_NEAR(image.edge_v().x(), -3, 1e-6);
  EXPECT_EQ(image.pixels().SerializeAsString(), mottled(texture_of(3, 0.5F)).SerializeAsString());
}

// From one reflectance to the other, without a seam where images meet, and the rougher the more.
TEST(GroundTexture, IsNoiseWithoutASeam) {
  const auto side = static_cast<size_t>(kTexturePixels);
  double before = 0;
  for (const float persistence : {0.0F, 0.5F, 1.0F}) {
    double inner = 0, seam = 0;
    for (uint64_t seed = 0; seed < 16; ++seed) {
      const auto rgb = from_bytes<float>(mottled(texture_of(seed, persistence)).rgb());
      EXPECT_NEAR(*std::ranges::min_element(rgb), 0.1F, 1e-6F);
      EXPECT_NEAR(*std::ranges::max_element(rgb), 0.6F, 1e-6F);
      // Squares of the difference of neighbours, in the row; the last is beside the first.
      for (size_t y = 0; y < side; ++y) {
        for (size_t x = 0; x < side; ++x) {
          const double step =
              double{rgb[3 * (y * side + x)]} - double{rgb[3 * (y * side + (x + 1) % side)]};
          (x + 1 == side ? seam : inner) += step * step;
        }
      }
    }
    inner /= static_cast<double>(side - 1);
    // At the seam of the coarsest lattice it is smoother than in the middle of its cells.
    EXPECT_LT(seam, 2 * inner) << persistence;
    EXPECT_GT(inner, 2 * before) << persistence;
    before = inner;
  }
}

TEST(GroundTexture, HasTheSameBitsEverywhere) {
  EXPECT_EQ(to_hex(sha256(mottled(texture_of(7, 0.7F)).rgb())),
            "9e544b16a415d49548a4c37290a994ac86c5dfdb0641dec1c68af4e3db85232f");
}

// Offsets move the object in the image: to the right, and upwards.
TEST(ItemScene, OffsetsAreThoseOfTheImage) {
  v1::DatasetItem item = upright_item();
  item.mutable_camera()->set_offset_x(0.125F);
  item.mutable_camera()->set_offset_y(0.0625F);
  RenderPool pool({});
  RenderJob job{serialize(scene_of(item, triangles_of("sphere"), 64)), {}};
  job.request.mutable_material()->set_sigma_t(10);
  job.request.set_spp(1);
  job.request.set_pixels(v1::OBJECT_PIXELS);
  const v1::RenderGradReply reply = pool.submit(job).get();
  const std::vector<float> mask = from_bytes<float>(reply.mask());
  double x = 0, y = 0, sum = 0;
  for (size_t p = 0; p < mask.size(); ++p) {
    x += mask[p] * (static_cast<double>(p % 64) + 0.5);
    y += mask[p] * (static_cast<double>(p / 64) + 0.5);
    sum += mask[p];
  }
  EXPECT_NEAR(x / sum, 32 + 8, 0.3);
  EXPECT_NEAR(y / sum, 32 - 4, 0.3);
  EXPECT_NEAR(std::sqrt(sum / std::numbers::pi), 16, 0.3);  // half of the frame is its diameter
}

// A manifest from a stranger may ask for a panorama of any size.
TEST(ItemScene, ChecksWhatItsSizeFollowsFrom) {
  const auto check = [](const auto& change) {
    v1::DatasetItem item = upright_item();
    v1::Emitter& emitter = *item.mutable_light()->mutable_studio()->add_emitters();
    emitter.set_size_degrees(4);
    emitter.set_aspect(0.25F);
    change(item, emitter);
    check_item(item, "items[0]");
  };
  const auto expect_refused = [&](const std::string& message, const auto& change) {
    testing::expect_error(ErrorKind::kInvalidInput, {message}, [&] { check(change); });
  };
  EXPECT_NO_THROW(check([](auto&, auto&) {}));
  expect_refused("items[0].channel is 9; it must be LUMINANCE, RED, GREEN, BLUE or RGB",
                 [](auto& item, auto&) { item.set_channel(static_cast<v1::Film::Channel>(9)); });
  expect_refused("items[0] has the channel RGB and 0 colours",
                 [](auto& item, auto&) { item.set_channel(v1::Film::RGB); });
  expect_refused("items[0] has the channel LUMINANCE and 1 colours",
                 [](auto& item, auto&) { item.add_colours(); });
  const auto add_colours = [](v1::DatasetItem& item, double g_of_blue) {
    item.set_channel(v1::Film::RGB);
    for (const double g : {0.2, 0.2, g_of_blue}) {
      item.add_colours()->set_sigma_t(10);
      item.mutable_colours()->rbegin()->set_g(g);
    }
  };
  EXPECT_NO_THROW(check([&](auto& item, auto&) { add_colours(item, 0.2); }));
  expect_refused("items[0].colours have the g 0.2 and 0.3",
                 [&](auto& item, auto&) { add_colours(item, 0.3); });
  expect_refused("g is 2", [&](auto& item, auto&) { add_colours(item, 2); });
  expect_refused("items[0].light.studio.emitters[0].temperature is 5;",
                 [](auto&, auto& emitter) { emitter.set_temperature(5); });
  expect_refused("items[0].light.lamp.ambient_temperature is -1;", [](auto& item, auto&) {
    item.mutable_light()->mutable_lamp()->set_ambient_temperature(-1);
  });
  for (const float size : {0.0F, 1e-9F, 121.0F}) {
    expect_refused("items[0].light.studio.emitters[0].size_degrees is",
                   [&](auto&, auto& emitter) { emitter.set_size_degrees(size); });
  }
  expect_refused("emitters[0].aspect is 0;", [](auto&, auto& emitter) { emitter.set_aspect(0); });
  expect_refused("emitters[0].elevation_degrees is -90;",
                 [](auto&, auto& emitter) { emitter.set_elevation_degrees(-90); });
  expect_refused("the number of items[0].light.studio.emitters is 0;",
                 [](auto& item, auto&) { item.mutable_light()->mutable_studio()->Clear(); });
  expect_refused("items[0].camera.distance is nan;", [](auto& item, auto&) {
    item.mutable_camera()->set_distance(std::numeric_limits<float>::quiet_NaN());
  });
  expect_refused("items[0].rotation.axis is (0, 0, 0)",
                 [](auto& item, auto&) { item.mutable_rotation()->set_angle_degrees(5); });
}

// The luminance of the room stays what it is; a bulb's room in daylight is blue beside the bulb.
TEST(ItemScene, HasTheColourOfTheRoomBesideThatOfTheLamp) {
  const auto lights = [](float kelvin, float ambient_kelvin) {
    v1::DatasetItem item = upright_item();
    v1::Lamp& lamp = *item.mutable_light()->mutable_lamp();
    lamp.set_irradiance(50);
    lamp.set_distance(5);
    lamp.set_radius(0.1F);
    lamp.set_ambient(0.4F);
    lamp.set_temperature(kelvin);
    lamp.set_ambient_temperature(ambient_kelvin);
    check_item(item, "items[0]");
    return scene_of(item, triangles_of("cube"), 16).lights();
  };
  const double radiance = 0.4 * 50 / std::numbers::pi;
  for (const float same : {0.0F, 3000.0F}) {
    ASSERT_EQ(lights(same, same).size(), 2);
    EXPECT_NEAR(lights(same, same)[1].constant().radiance(), radiance, 1e-5);
  }
  const auto room = lights(2700, 6500)[1].environment_map().pixels();
  EXPECT_NEAR(irradiance_from_above(room), std::numbers::pi * radiance, 1e-4);
  const double red = irradiance_from_above(room, v1::Film::RED);
  const double blue = irradiance_from_above(room, v1::Film::BLUE);
  const std::array<double, 3> bulb = colour_of_black_body(2700), day = colour_of_black_body(6500);
  EXPECT_NEAR(blue / red, day[2] / bulb[2] * bulb[0] / day[0], 1e-4);
  EXPECT_GT(blue, 3 * red);
}

TEST(WhiteOf, IsTheColourOfLampAndRoomTogether) {
  v1::DatasetItem item;
  v1::Flash& flash = *item.mutable_light()->mutable_flash();
  flash.set_ambient(1);
  flash.set_ambient_temperature(3000);
  const std::array<double, 3> warm = colour_of_black_body(3000);
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(white_of(item).at(c), 1 + warm.at(c), 1e-12);
  flash.set_temperature(3000);
  for (const double value : white_of(item)) EXPECT_NEAR(value, 2, 1e-12);
  // A soft box alone, then walls alone.
  v1::Studio& studio = *item.mutable_light()->mutable_studio();
  studio.add_emitters()->set_strength(0.3F);
  studio.mutable_emitters(0)->set_temperature(3000);
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(white_of(item).at(c), warm.at(c), 1e-12);
  studio.set_walls(1);
  EXPECT_EQ(white_of(item), (std::array<double, 3>{1, 1, 1}));
}

// What is white has the luminance of the light, and the colour of a low sun or of the sky.
TEST(WhiteOf, IsTheColourOfTheLightThatFallsFromAbove) {
  v1::DatasetItem item;
  item.mutable_light()->mutable_flash()->set_irradiance(100);
  EXPECT_EQ(white_of(item), (std::array<double, 3>{1, 1, 1}));
  v1::SunSky& sun = *item.mutable_light()->mutable_sun_sky();
  sun.set_turbidity(6);
  sun.set_sun_angular_radius_degrees(2);
  sun.set_sky_scale(0);
  const auto white_at = [&](float elevation) {
    sun.set_sun_elevation_degrees(elevation);
    const std::array<double, 3> white = white_of(item);
    EXPECT_NEAR(0.2126 * white[0] + 0.7152 * white[1] + 0.0722 * white[2], 1, 1e-3);
    return white;
  };
  const std::array<double, 3> low = white_at(12), high = white_at(80);
  EXPECT_GT(low[0] / low[2], 1.1 * high[0] / high[2]);
  sun.set_sky_scale(1);
  sun.set_sun_scale(0);
  const std::array<double, 3> sky = white_at(30);
  EXPECT_GT(sky[2], sky[0]);
}

}  // namespace
}  // namespace itn
