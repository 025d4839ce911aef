// Renders of materials: as a photograph's object would look, and on shapes of our own.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "client/panels.h"
#include "client/predict/photograph_input.h"
#include "client/render/job_renderer.h"
#include "common/material.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// The object of a scene that shows what the photograph shows, framed as the photograph is; channels
// interleaved. `materials` are those of an object whose longest side is 1 mm, and are made such
// that the scene's object, whatever its size, looks like that. One: in the scene's channel. Three:
// R, G and B, each with its own. `spp`: samples per pixel of the frame. Throws Error (invalid
// input) if the sides of the film are not to each other as the photograph's are, and what renders
// throw.
std::vector<float> rerendered(JobRenderer& pool, v1::Scene scene, const PredictInput& photograph,
                              std::span<const Material> materials, uint32_t spp);

struct Swatch {
  std::string shape, light;  // in words
  Panel picture;
};

// A material, of an object whose longest side is 1 mm, on two built-in shapes under two lights, on
// the ground; in colour if there are three. White is the 99th percentile. `rendered` is called
// after each of the kSwatches.
std::vector<Swatch> render_swatches(JobRenderer& pool, std::span<const Material> materials,
                                    uint32_t spp, const std::function<void()>& rendered);
inline constexpr size_t kSwatches = 4;

}  // namespace itn
