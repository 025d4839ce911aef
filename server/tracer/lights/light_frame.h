// What lights are compiled for: a film's channel, and an object, in whose coordinates they stand.
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
  Pose pose;           // of the object
  const Mesh& object;  // closed, or of no triangles
  PartCache& parts;
  std::vector<std::string>& part_keys;  // of what lights take from `parts`: to be appended to

  // A table that depends on what the key consists of.
  template <typename Table, typename Build>
  std::shared_ptr<const Table> table(const std::string& key, const Build& build) const {
    return parts.get<Table>(part_keys.emplace_back(key), {}, build);
  }
};

// About +y, so that what stood at `azimuth` comes to stand over -z.
Rotation<double> turned_back(double azimuth);

}  // namespace itn::tracer
