#include "client/object_media.h"

#include <fmt/format.h>

#include "client/measured_media.h"
#include "common/error.h"
#include "common/fields.h"
#include "common/scene/field_check.h"
#include "common/scene/material_proto.h"
#include "common/scene/mesh_builder.h"

namespace itn {

size_t number_of_channel(v1::Film::Channel shown) {
  return shown == v1::Film::RED ? 0 : shown == v1::Film::BLUE ? 2 : 1;
}

Material material_of(const std::string& medium, double size, const std::string& field,
                     const v1::Object& object, v1::Film::Channel shown) {
  Material material = measured_medium(medium).material(number_of_channel(shown));
  if (size > 0) material.sigma_t *= size / longest_side(object_bounds(field, object));
  return material;
}

std::optional<Material> material_of(const std::string& field, const v1::Object& object,
                                    v1::Film::Channel shown) {
  const int materials = object.material_size();
  if (object.has_medium() && materials > 0) {
    throw invalid_input(field + " has a medium and a material; it must have one of them");
  }
  if (materials > 0) {
    if (materials != 1 && materials != kMaxMaterials) {
      throw invalid_input(
          fmt::format("{} has {} materials; it must have one, or {}, in red, green and blue", field,
                      materials, kMaxMaterials));
    }
    const int number = materials == 1 ? 0 : static_cast<int>(number_of_channel(shown));
    const Material material = from_proto(object.material(number));
    validate(material, field + ".material");
    return material;
  }
  if (!object.has_medium()) return std::nullopt;
  const double size =
      in_closed(field + ".medium.object_size", double{object.medium().object_size()}, 0, 1e6);
  return material_of(object.medium().name(), size, field, object, shown);
}

void resolve_media(v1::Scene& scene) {
  for (int i = 0; i < scene.other_objects_size(); ++i) {
    v1::Object& object = *scene.mutable_other_objects(i);
    const std::string field = fmt::format("scene.other_objects[{}]", i);
    if (const auto material = material_of(field, object, scene.film().channel())) {
      object.clear_medium();
      object.clear_material();
      *object.add_material() = to_proto(*material);
    }
  }
}

}  // namespace itn
