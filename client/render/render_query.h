// A render as it is asked for and as it comes back, in plain values: what refinements, trainings,
// datasets and commands have in common.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "client/render/render_job.h"
#include "common/material.h"
#include "common/render_estimate.h"
#include "common/scene/scene_bytes.h"
#include "itn/v1/render.pb.h"

namespace itn {

class JobRenderer;

// A number of the scene, by the name of its derivative (RenderGradRequest.values).
struct SceneValue {
  std::string name;
  double value = 0;
};

// The names of the derivatives by the material.
inline constexpr std::array<const char*, 3> kMaterialParameters{"sigma_t", "albedo", "g"};

struct RenderQuery {
  std::shared_ptr<const SerializedScene> scene;
  Material material;
  // Materials of red, green and blue, which then share the paths of one render, instead of
  // `material`.
  std::vector<Material> colours = {};
  std::optional<v1::PhaseFunction> phase = {};  // instead of Henyey and Greenstein's
  std::vector<SceneValue> values = {};          // instead of those that the scene has
  uint32_t spp = 0;                             // samples per pixel, over all estimates
  uint64_t seed = 0;
  uint32_t estimates = 1;  // independent ones
  uint32_t pilot_spp = 0;  // of a pilot, which quietens the derivatives in sigma_t and g
  std::vector<std::string> derivatives = {};  // names (RenderGradRequest.parameters)
  v1::RenderedPixels pixels = v1::OBJECT_PIXELS;
  v1::Tracer tracer = v1::WAVEFRONT;
  // If they are given, the loss against the image and its gradient come back, and no images: by
  // pixel, weights >= 0.
  std::span<const float> image = {}, weight = {};
};

RenderJob job_of(const RenderQuery& query);

struct Render {
  std::vector<RenderEstimate> estimates;
  std::vector<float> mask;  // part of each pixel that the object covers
  LossWithGradient loss;
  double cpu_seconds = 0;
};

Render render_of(const v1::RenderGradReply& reply);

// Renders each of them. May throw Error.
using Renderer = std::function<std::vector<Render>(std::span<const RenderQuery>)>;

// All at the same time by a JobRenderer, which must outlive it.
Renderer rendered_by(JobRenderer& renderer, std::stop_token stop = {});

}  // namespace itn
