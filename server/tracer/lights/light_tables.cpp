#include "server/tracer/lights/light_tables.h"

namespace itn::tracer {

LightTables::LightTables(const Lights& all) {
  for (const Lights::Choice& choice : all.choices()) {
    const auto probability = static_cast<float>(choice.probability);
    const auto cumulative = static_cast<float>(choice.cumulative);
    if (!choice.source) {
      lights.push_back({Kind::kBeam, beams.size(), cumulative});
      beams.push_back(
          {choice.direction, static_cast<float>(choice.irradiance / choice.probability)});
    } else if (const auto* cone = dynamic_cast<const ConeSource*>(choice.source.get())) {
      lights.push_back({Kind::kCone, cones.size(), cumulative});
      const Vec3f axis = cone->basis().n;
      cones.push_back({cone->basis(), static_cast<float>(cone->one_minus_cos()),
                       static_cast<float>(cone->radiance(axis)),
                       static_cast<float>(choice.probability * cone->pdf(axis))});
    } else if (const auto* sky = dynamic_cast<const SkySource*>(choice.source.get())) {
      lights.push_back({Kind::kSky, skies.size(), cumulative});
      skies.push_back({sky->values().data(), sky->cells().entries().data(),
                       sky->cells().probabilities().data(), probability});
    } else if (const auto* map = dynamic_cast<const MapSource*>(choice.source.get())) {
      lights.push_back({Kind::kMap, maps.size(), cumulative});
      Map& table = maps.emplace_back(Map{map->width(),
                                         map->height(),
                                         static_cast<float>(map->rotation01()),
                                         map->values().data(),
                                         map->cells().entries().data(),
                                         map->cells().probabilities().data(),
                                         probability,
                                         {},
                                         {}});
      const std::vector<double>& edges = map->edges();
      for (size_t row = 0; row < edges.size(); ++row) {
        table.edges.push_back(static_cast<float>(edges[row]));
        if (row + 1 < edges.size()) {
          table.inverse_angles.push_back(static_cast<float>(
              map->width() / (2 * std::numbers::pi * (edges[row] - edges[row + 1]))));
        }
      }
    } else {
      lights.push_back({Kind::kUniform, 0, cumulative});
      uniform_radiance += static_cast<float>(choice.source->radiance({}));
      uniform_density += static_cast<float>(choice.probability * choice.source->pdf({}));
    }
  }
  lights.back().cumulative = 2;  // above every uniform number
}

}  // namespace itn::tracer
