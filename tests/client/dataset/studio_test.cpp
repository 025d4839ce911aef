#include "client/dataset/studio.h"

#include <cmath>
#include <numbers>

#include "client/dataset/panorama.h"
#include "client/dataset/plan.h"
#include "client/image/spectrum.h"
#include "client/scene/text_proto.h"
#include "common/angle.h"
#include "common/scene/wire_array.h"
#include "common/vec.h"
#include "server/tracer/lights/lights.h"
#include "tests/client/dataset/dataset_support.h"

namespace itn {
namespace {

constexpr double kStraightAngle = std::numbers::pi;

// The light as the tracer sees it.
tracer::Lights light_of(const v1::Pixels& pixels) {
  tracer::EnvironmentMapLight map;
  map.width = static_cast<int>(pixels.width());
  map.height = static_cast<int>(pixels.height());
  map.rgb = from_bytes<float>(pixels.rgb());
  return {{map}, tracer::Channel::kLuminance};
}

// 0 is -z, 90 is +x.
Vec3d direction(double azimuth_degrees, double elevation_degrees) {
  const double a = azimuth_degrees * kRadiansPerDegree, e = elevation_degrees * kRadiansPerDegree;
  return {std::sin(a) * std::cos(e), std::sin(e), -std::cos(a) * std::cos(e)};
}

// Integrates f(direction) times the radiance over the sphere.
template <typename F>
double integral(const tracer::Lights& light, const F& f) {
  constexpr int kRows = 360;
  double sum = 0;
  for (int row = 0; row < kRows; ++row) {
    const double elevation = 90 - (row + 0.5) * 180 / kRows;
    for (int column = 0; column < 2 * kRows; ++column) {
      const Vec3d d = direction((column + 0.5) * 180 / kRows, elevation);
      sum += f(d) * static_cast<double>(light.radiance(static_cast<Vec3f>(d))) *
             std::cos(elevation * kRadiansPerDegree);
    }
  }
  return sum * std::pow(kStraightAngle / kRows, 2);
}

double irradiance_on(const tracer::Lights& light, Vec3d normal) {
  return integral(light, [&](Vec3d d) { return std::max(0.0, dot(d, normal)); });
}

v1::Studio studio(const std::string& text) {
  v1::Studio result;
  parse_text_proto("irradiance: 100 " + text, "studio", result);
  return result;
}

// Temperatures change the colours of a studio, and nothing in its luminance.
TEST(Studio, HasTheColoursOfItsEmittersAndWalls) {
  const std::string emitter =
      "emitters { size_degrees: 30 aspect: 1 elevation_degrees: 90 edge: 0.5 strength: 1 ";
  const v1::Pixels gray = studio_panorama(studio("walls: 0.2 " + emitter + "}"));
  const v1::Pixels coloured = studio_panorama(
      studio("walls: 0.2 walls_temperature: 3000 " + emitter + "temperature: 9000 }"));
  const auto gray_rgb = from_bytes<float>(gray.rgb()), rgb = from_bytes<float>(coloured.rgb());
  const std::array<double, 3> walls = colour_of_black_body(3000), box = colour_of_black_body(9000);
  ASSERT_EQ(rgb.size(), gray_rgb.size());
  const float of_walls = gray_rgb.back();
  for (size_t i = 0; i < rgb.size(); ++i) {
    const double expected = of_walls * walls[i % 3] + (gray_rgb[i] - of_walls) * box[i % 3];
    ASSERT_NEAR(rgb[i], expected, 1e-5 * expected);
  }
  EXPECT_NEAR(irradiance_from_above(coloured), irradiance_from_above(gray), 1e-4);
}

TEST(Studio, IrradianceIsAsAsked) {
  const v1::DatasetConfig config = preset_config("studio");
  const NameSplit shapes{{"a"}, {"b"}, {"c"}};
  for (uint64_t i = 0; i < 8; ++i) {
    v1::Studio drawn = plan_item(config, shapes, i).light().studio();
    drawn.set_irradiance(static_cast<float>(10 * (i + 1)));
    const tracer::Lights light = light_of(studio_panorama(drawn));
    EXPECT_NEAR(irradiance_on(light, {0, 1, 0}) / drawn.irradiance(), 1, 0.01) << i;
    // Below the horizon are the walls, and what of the emitters hangs down there.
    const double walls = static_cast<double>(drawn.walls() * drawn.irradiance()) / kStraightAngle;
    EXPECT_NEAR(light.radiance(Vec3f{0, -1, 0}) / walls, 1, 1e-5) << i;
  }
  // The smallest there are, and a room without any.
  const v1::Studio small = studio(
      "walls: 0.1 emitters { size_degrees: 4 aspect: 0.25 roll_degrees: 30 elevation_degrees: 40 "
      "azimuth_degrees: 200 strength: 1 }");
  EXPECT_NEAR(irradiance_on(light_of(studio_panorama(small)), {0, 1, 0}), 100, 1);
  const v1::Studio room = studio(
      "walls: 1 emitters { is_lamp: true size_degrees: 9 elevation_degrees: 9 strength: 1 }");
  for (const float radiance : from_bytes<float>(studio_panorama(room).rgb())) {
    EXPECT_FLOAT_EQ(radiance, static_cast<float>(100 / kStraightAngle));
  }
}

TEST(Studio, EmittersAreWhereTheyAreAsked) {
  for (const double elevation : {0.0, 20.0, 65.0, 90.0}) {
    for (const double azimuth : {0.0, 75.0, 355.0}) {
      for (const bool is_lamp : {false, true}) {
        v1::Studio one = studio(
            "emitters { size_degrees: 40 aspect: 0.5 roll_degrees: 90 edge: 0.2 "
            "strength: 1 }");
        v1::Emitter& emitter = *one.mutable_emitters(0);
        emitter.set_is_lamp(is_lamp);
        emitter.set_azimuth_degrees(static_cast<float>(azimuth));
        emitter.set_elevation_degrees(static_cast<float>(elevation));
        const v1::Pixels pixels = studio_panorama(one);
        const tracer::Lights light = light_of(pixels);
        const Vec3d mean{integral(light, [](Vec3d d) { return d.x; }),
                         integral(light, [](Vec3d d) { return d.y; }),
                         integral(light, [](Vec3d d) { return d.z; })};
        const Vec3d middle = direction(azimuth, elevation);
        const double miss =
            std::acos(std::min(1.0, dot(normalize(mean), middle))) / kRadiansPerDegree;
        EXPECT_LT(miss, 0.1 * 180 / pixels.height())
            << azimuth << " " << elevation << " " << is_lamp;
        // A rectangle that stands upright: 40 degrees high, 20 wide.
        const auto lit = [&](double to_the_right, double up) {
          const Vec3d right = direction(azimuth + 90, 0), above = cross(right, middle);
          const Vec3d d = normalize(middle + right * std::tan(to_the_right * kRadiansPerDegree) +
                                    above * std::tan(up * kRadiansPerDegree));
          return light.radiance(static_cast<Vec3f>(d)) / light.radiance(static_cast<Vec3f>(middle));
        };
        EXPECT_GT(lit(0, 12), 0.95F);
        EXPECT_GT(lit(0, -12), 0.95F);
        if (is_lamp) {
          EXPECT_GT(lit(12, 0), 0.95F);
        } else {
          EXPECT_LT(lit(15, 0), 0.01F);
        }
        EXPECT_LT(lit(0, 25), 0.01F);
        EXPECT_LT(lit(25, 0), 0.01F);
      }
    }
  }
}

TEST(Studio, StrengthsAreWhatSurfacesThatFaceThemGet) {
  // Opposite each other, of different sizes.
  const v1::Studio two = studio(
      "emitters { is_lamp: true size_degrees: 15 elevation_degrees: 0 strength: 4 }"
      "emitters { size_degrees: 50 aspect: 0.7 azimuth_degrees: 180 strength: 1 edge: 1 }");
  const tracer::Lights light = light_of(studio_panorama(two));
  EXPECT_NEAR(irradiance_on(light, {0, 0, -1}) / irradiance_on(light, {0, 0, 1}), 4, 0.08);
}

TEST(Studio, PixelsAreAsFineAsTheSmallestEmitterNeeds) {
  const auto height = [](const std::string& emitters) {
    const v1::Pixels pixels = studio_panorama(studio(emitters));
    EXPECT_EQ(pixels.width(), 2 * pixels.height());
    return pixels.height();
  };
  const std::string large =
      "emitters { is_lamp: true size_degrees: 60 elevation_degrees: 50 "
      "strength: 1 }";
  EXPECT_EQ(height(large), 64);
  EXPECT_EQ(height(large + "emitters { size_degrees: 12 aspect: 0.5 elevation_degrees: 50 "
                           "strength: 1 }"),
            120);
}

TEST(Studio, IsAFunctionOfItsNumbers) {
  const v1::DatasetConfig config = preset_config("studio");
  const NameSplit shapes{{"a"}, {"b"}, {"c"}};
  const v1::Studio drawn = plan_item(config, shapes, 5).light().studio();
  EXPECT_EQ(studio_panorama(drawn).rgb(), studio_panorama(drawn).rgb());
  v1::Studio other = drawn;
  other.mutable_emitters(0)->set_azimuth_degrees(drawn.emitters(0).azimuth_degrees() + 1);
  EXPECT_NE(studio_panorama(other).rgb(), studio_panorama(drawn).rgb());
}

}  // namespace
}  // namespace itn
