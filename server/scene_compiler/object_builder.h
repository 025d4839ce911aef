// The object of a scene, other objects and surfaces: their shapes and what they are made of.
#pragma once

#include <string>

#include "common/part_cache.h"
#include "common/scene/mesh_builder.h"
#include "itn/v1/scene.pb.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// All throw Error as in common/scene/field_check.h, whose `field` names the message, and count
// their triangles in `meshes`.

// Sets the object of the scene, and its pose. With `parts`, sets its key, too, and takes it from
// there if it is held.
void build_object(const std::string& field, const v1::Object& proto, MeshBuilder& meshes,
                  PartCache* parts, tracer::SceneDescription& scene);

tracer::Boundary build_boundary(const std::string& field, const v1::Object& proto);

tracer::OtherObject build_other_object(const std::string& field, const v1::Object& proto,
                                       MeshBuilder& meshes);

tracer::DiffuseSurface build_surface(const std::string& field, const v1::Surface& proto,
                                     MeshBuilder& meshes);

}  // namespace itn
