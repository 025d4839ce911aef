// Renders of materials: as a photograph's object would look, and on shapes of our own.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "client/panels.h"
#include "client/render_pool/render_pool.h"
#include "common/material.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// An image of the scene, with the film's size changed to side x side pixels, its object alone;
// channels interleaved. `materials` are those of an object whose longest side is 1 mm, and are made
// such that the scene's object, whatever its size, looks like that. One: in the scene's channel.
// Three: R, G and B, each with its own. Throws Error (invalid input) if the film is no square, and
// what renders throw.
std::vector<float> rerendered(RenderPool& pool, v1::Scene scene, int side,
                              std::span<const Material> materials);

struct Swatch {
  std::string shape, light;  // in words
  Panel picture;
};

// A material, of an object whose longest side is 1 mm, on two built-in shapes under two lights, on
// the ground; in colour if there are three. White is the 99th percentile.
std::vector<Swatch> render_swatches(RenderPool& pool, std::span<const Material> materials);

}  // namespace itn
