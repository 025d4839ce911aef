// What a program asks of the renderer inside it without rendering: whether a scene can be rendered,
// what its numbers are, and which derivatives there are. Renders themselves are asked of workers,
// of which one can be inside the program, too (server/render/render_server.h). Nothing else of the
// server is known to clients.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "itn/v1/render.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

namespace tracer {
struct SceneDescription;
}

// Throws Error (invalid input, or a limit of workers) unless a worker would render the scene. Paths
// of files are refused.
void check_scene(const v1::Scene& scene);

// All names that RenderGradRequest.parameters may have, with K for any number.
std::vector<std::string> derivative_names();
// Whether a parameter of such a name is of the medium, rather than of the scene. Throws Error
// (invalid input), which says what names there are.
bool is_of_medium(const std::string& parameter);
// Whether colours that share their paths have derivatives in a parameter of such a name. Throws
// Error (invalid input), which says what names there are.
bool shares_paths(const std::string& parameter);

struct SceneNumber {
  double value = 0;          // in the unit of its field in scene.proto
  double low = 0, high = 0;  // its range; infinite ends: a coordinate may be any number
};

// The numbers of a scene, by the names of their derivatives.
class SceneNumbers {
 public:
  // Throws Error (invalid input, or a limit of workers) where a field is out of its range.
  explicit SceneNumbers(const v1::Scene& scene);
  // Throws Error (invalid input) where there is no such parameter, or not in this scene. A light's
  // scale is 1.
  SceneNumber number(const std::string& parameter) const;

 private:
  std::shared_ptr<const tracer::SceneDescription> scene_;
};

struct SurfaceOfMedium {
  double index = 1;      // of refraction
  double roughness = 0;  // alpha of GGX; 0: smooth
};

// The boundary of an object's medium, with defaults where the message says nothing; nothing if it
// is index-matched. Throws Error (invalid input); `field` names the object.
std::optional<SurfaceOfMedium> surface_of_medium(const std::string& field,
                                                 const v1::Object& object);

// The light of sun and sky on a surface that faces up, in W/m^2, in the channel of a film; the
// ground adds nothing. Throws Error (invalid input).
double irradiance_from_above(const v1::SunSky& light, v1::Film::Channel channel);

}  // namespace itn
