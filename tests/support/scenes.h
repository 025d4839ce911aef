// Scenes and requests as messages, for tests of whatever takes them off the wire.
#pragma once

#include <google/protobuf/text_format.h>

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/scene/wire_array.h"
#include "itn/v1/render.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn::testing {

template <typename Message>
Message parse_text(const std::string& text) {
  Message message;
  if (!google::protobuf::TextFormat::ParseFromString(text, &message)) {
    throw std::runtime_error("not a valid message: " + text);
  }
  return message;
}

// A cube of 1 mm that stands on y = 0.
inline v1::Triangles cube() {
  std::vector<float> positions;
  for (int i = 0; i < 8; ++i) {
    positions.push_back(i & 1 ? 0.5F : -0.5F);
    positions.push_back(i & 2 ? 1.0F : 0.0F);
    positions.push_back(i & 4 ? 0.5F : -0.5F);
  }
  const std::vector<uint32_t> indices = {0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4,
                                         2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6};
  v1::Triangles triangles;
  triangles.set_positions(to_bytes(positions));
  triangles.set_indices(to_bytes(indices));
  return triangles;
}

// Under a constant light and a sun, on a ground.
inline v1::Scene cube_scene(int width = 16, int height = 12) {
  auto scene = parse_text<v1::Scene>(R"(
    surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } }
    lights { constant { radiance: 0.3 } }
    lights { directional { direction { x: 1 y: 2 z: -1 } irradiance: 2 } }
    camera { origin { y: 1.5 z: -4 } target { y: 0.5 } fov_degrees: 22 })");
  *scene.mutable_object()->mutable_mesh()->mutable_triangles() = cube();
  scene.mutable_film()->set_width(static_cast<uint32_t>(width));
  scene.mutable_film()->set_height(static_cast<uint32_t>(height));
  return scene;
}

// Without scene or digest.
inline v1::RenderGradRequest small_request(uint32_t spp = 8) {
  auto request = parse_text<v1::RenderGradRequest>(R"(
    material { sigma_t: 8 albedo: 0.9 g: 0.3 }
    seed: 5
    derivatives: [SIGMA_T, ALBEDO, G, SIGMA_A, SIGMA_S, SIGMA_S_REDUCED]
    estimates: 2)");
  request.set_spp(spp);
  return request;
}

// Takes days.
inline v1::RenderGradRequest endless_request() {
  auto request = small_request(1U << 20);
  request.mutable_material()->set_sigma_t(200);
  request.mutable_material()->set_albedo(0.999);
  return request;
}

// All of the reply that must not depend on where and how it was rendered.
inline std::string deterministic_bytes(v1::RenderGradReply reply) {
  reply.mutable_counters()->clear_cpu_seconds();
  return reply.SerializeAsString();
}

}  // namespace itn::testing
