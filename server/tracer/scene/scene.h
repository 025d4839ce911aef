// What the tracer renders: a homogeneous medium inside a closed mesh, opaque diffuse surfaces,
// distant lights, a pinhole camera. Plain data, and the compiled form that rays are traced against.
//
// Right-handed, y up; lengths in mm; angles in radians; radiance in W/(m^2 sr) on the scale of the
// lights.
#pragma once

#include <cstddef>
#include <memory>
#include <variant>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/vec.h"

namespace itn::tracer {

// Reflects with radiance = reflectance * irradiance / pi on both sides.
struct DiffuseSurface {
  Mesh mesh;
  float reflectance = 0.5F;
};

// Clear sky of Hosek and Wilkie with a sun of constant radiance over its disc.
struct SunSkyLight {
  double turbidity = 3;              // [1, 10]
  double ground_albedo = 0.15;       // [0, 1]
  double sun_elevation = 1.0471976;  // [0, pi/2]
  double sun_azimuth = 0;            // 0 is -z, pi/2 is +x
  double sun_angular_radius = 0.00465;
  double sun_scale = 1;
  double sky_scale = 1;
};

// Latitude-longitude panorama, u = atan2(x, -z) / 2 pi, v = acos(y) / pi, bilinear.
struct EnvironmentMapLight {
  int width = 0;
  int height = 0;
  std::vector<float> rgb;  // 3 * width * height, top row first
  double scale = 1;
  double rotate_y = 0;
};

struct ConstantEnvironment {
  double radiance = 1;
};

struct DirectionalBeam {
  Vec3d direction{0, 1, 0};  // towards the light
  double irradiance = 1;     // on a surface that faces it
};

using LightDescription =
    std::variant<SunSkyLight, EnvironmentMapLight, ConstantEnvironment, DirectionalBeam>;

struct CameraDescription {
  Vec3d origin;
  Vec3d target;
  Vec3d up{0, 1, 0};
  double fov = 0.698;  // horizontal
};

// Which part of coloured lights is rendered.
enum class Channel { kLuminance, kRed, kGreen, kBlue };

struct FilmDescription {
  int width = 0;
  int height = 0;
  Channel channel = Channel::kLuminance;
};

struct SceneDescription {
  Mesh object;  // closed, outward oriented
  std::vector<DiffuseSurface> surfaces;
  std::vector<LightDescription> lights;
  CameraDescription camera;
  FilmDescription film;
};

// What a scene takes at most while it is checked, compiled and rendered, by its numbers of
// triangles, pixels of its panoramas and film pixels, in bytes: whatever the shapes are, for a
// service to decide by before it makes a Scene. Without the description itself, and without the
// sums of a film.
size_t estimated_memory(const SceneDescription& description);

// Compiled and immutable; may be shared by any number of renders.
class Scene {
 public:
  // Throws Error (invalid input) if the object does not bound a volume (see validate_closed), a
  // light's numbers are out of range, or the camera is degenerate.
  explicit Scene(SceneDescription description);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  int width() const;
  int height() const;
  size_t surface_count() const;
  size_t light_count() const;
  // Rough size in memory, in bytes, for caches.
  size_t memory() const;

  struct Compiled;
  const Compiled& compiled() const { return *compiled_; }

 private:
  std::unique_ptr<const Compiled> compiled_;
};

}  // namespace itn::tracer
