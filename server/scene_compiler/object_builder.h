// The object of a scene, other objects and surfaces: their shapes and what they are made of.
#pragma once

#include <string>

#include "common/part_cache.h"
#include "common/scene/mesh_builder.h"
#include "itn/v1/scene.pb.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// These functions throw Error as in common/scene/field_check.h, where `field` names the message.
// Those that make meshes count their triangles in `meshes`.

// Sets what the scene has of its object: mesh, pose, normals at corners, boundary, smooth angle. If
// `parts` is not null, the scene gets the key of the object, and the compiled object, if `parts`
// holds it, in the place of the mesh.
void build_object(const std::string& field, const v1::Object& proto, MeshBuilder& meshes,
                  PartCache* parts, tracer::SceneDescription& scene);

// Index-matched, if the message names no boundary.
tracer::Boundary build_boundary(const std::string& field, const v1::Object& proto);

// Requires one material.
tracer::OtherObject build_other_object(const std::string& field, const v1::Object& proto,
                                       MeshBuilder& meshes);

// In the coordinates of the scene, in mm.
tracer::DiffuseSurface build_surface(const std::string& field, const v1::Surface& proto,
                                     MeshBuilder& meshes);

}  // namespace itn
