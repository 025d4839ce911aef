// From the scene that came over the wire to what the tracer takes: every field is checked against
// the range that its comment in scene.proto states, before anything is allocated for it. All
// functions throw Error as in common/scene/field_check.h.
#pragma once

#include <cstdint>
#include <string>

#include "common/part_cache.h"
#include "common/render_limits.h"
#include "itn/v1/scene.pb.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// What one request may ask for; reported by GetCapabilities.
struct RenderLimits {
  uint64_t max_pixels = uint64_t{1} << 24;
  uint32_t max_spp = kMaxSamples;
  uint64_t max_triangles = 10'000'000;  // of all meshes of a scene together
  // The largest request or reply. Protocol buffers end at 2 GiB.
  uint64_t max_message_bytes = uint64_t{2047} << 20;
};

// Parses a serialized itn.v1.Scene of no more elements than one may have. A field that this program
// does not know is refused: it would change the image somewhere else and not here.
v1::Scene parse_scene(const std::string& bytes);

tracer::Channel build_channel(v1::Film::Channel channel);

// Throws Error as in common/scene/field_check.h; environment maps with a `path` are refused.
tracer::LightDescription build_light(const std::string& field, const v1::Light& proto);

// Meshes with a `path` are refused, as are environment maps. The object's last rotations and
// translations become its pose. With `parts`, the scene has the keys to share what it is compiled
// into there, and an object that is held is not built again.
tracer::SceneDescription build_scene(const v1::Scene& scene, const RenderLimits& limits,
                                     PartCache* parts = nullptr, const std::stop_token& stop = {});

}  // namespace itn
