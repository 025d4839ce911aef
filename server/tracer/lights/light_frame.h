// What lights need to be compiled: the film's channel, the object in whose coordinates they stand,
// and the cache of tables that scenes share.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/pose.h"
#include "common/part_cache.h"
#include "server/tracer/colour/channel.h"

namespace itn::tracer {

struct LightFrame {
  Channel channel;
  Pose pose;           // of the object in the scene
  const Mesh& object;  // closed, or of no triangles
  PartCache& parts;
  std::vector<std::string>& part_keys;  // of the tables that lights have taken from `parts`

  // The table of this key, which names all that it depends on; build() makes it if `parts` has
  // none.
  template <typename Table, typename Build>
  std::shared_ptr<const Table> table(const std::string& key, const Build& build) const {
    return parts.get<Table>(part_keys.emplace_back(key), {}, build);
  }
};

// The rotation about +y that turns what stands at `azimuth` to -z.
Rotation<double> turned_back(double azimuth);

}  // namespace itn::tracer
