#include "client/refine/observation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <future>

#include "client/render_pool/render_pool.h"
#include "common/error.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

// Independent estimates of each render. More of them waste less of the samples, as only products
// across them count, but their images all travel.
constexpr uint32_t kEstimates = 4;
// Of a pilot, which quietens the derivatives in sigma_t and g.
constexpr uint32_t kPilotSpp = 4;

void check_plane(const Observation& observation, const std::vector<float>& plane, const char* what,
                 bool required) {
  if (plane.empty() && !required) return;
  const SerializedScene& scene = *observation.scene;
  if (plane.size() != size_t{scene.width} * scene.height) {
    throw invalid_input(fmt::format("{}: the {} has {} pixels, the film of its scene {} x {}",
                                    observation.name, what, plane.size(), scene.width,
                                    scene.height));
  }
  const auto wrong = std::ranges::find_if(plane, [](float v) { return !std::isfinite(v); });
  if (wrong != plane.end()) {
    const auto pixel = static_cast<size_t>(wrong - plane.begin());
    throw invalid_input(fmt::format("{}: the {} is {} at pixel ({}, {}); it must be finite",
                                    observation.name, what, *wrong, pixel % scene.width,
                                    pixel / scene.width));
  }
}

RenderJob render_job(const SynthesisQuery& query) {
  RenderJob job{.scene = query.observation->scene, .request = {}};
  *job.request.mutable_material() = to_proto(query.material);
  job.request.set_spp(query.spp);
  job.request.set_seed(query.seed);
  job.request.set_estimates(kEstimates);
  job.request.set_pilot_spp(kPilotSpp);
  job.request.set_pixels(v1::OBJECT_PIXELS);
  for (const v1::Parameter parameter : {v1::SIGMA_T, v1::ALBEDO, v1::G}) {
    job.request.add_derivatives(parameter);
  }
  for (size_t i = 0; i < query.unknowns.size(); ++i) {
    job.request.add_parameters(query.unknowns[i].name);
    set_value(job.request, query.unknowns[i].name, query.values[i]);
  }
  return job;
}

Synthesis to_synthesis(const v1::RenderGradReply& reply) {
  Synthesis synthesis;
  for (const v1::Estimate& estimate : reply.estimates()) {
    tracer::RenderEstimate& to = synthesis.estimates.emplace_back();
    to.radiance = from_bytes<float>(estimate.radiance());
    for (const std::string& derivative : estimate.derivatives()) {
      to.derivatives.push_back(from_bytes<float>(derivative));
    }
  }
  synthesis.mask = from_bytes<float>(reply.mask());
  synthesis.cpu_seconds = reply.counters().cpu_seconds();
  return synthesis;
}

}  // namespace

void validate(const Observation& observation) {
  check_plane(observation, observation.radiance, "image", true);
  check_plane(observation, observation.mask, "mask", false);
  check_plane(observation, observation.noise, "noise", false);
  for (const std::vector<float>& plane : observation.disturbances) {
    check_plane(observation, plane, "disturbance", false);
  }
  if (std::ranges::any_of(observation.noise, [](float v) { return v < 0; })) {
    throw invalid_input(observation.name + ": the noise (stderr.Y) is below 0 at some pixels");
  }
  double sum = 0;
  bool any = observation.mask.empty();
  for (size_t p = 0; p < observation.radiance.size(); ++p) {
    const bool counts = observation.mask.empty() || observation.mask[p] > 0.5F;
    any = any || counts;
    if (counts) sum += observation.radiance[p];
  }
  if (!any) throw invalid_input(observation.name + ": the mask has no pixel on the object");
  if (!(sum > 0)) throw invalid_input(observation.name + ": the image is black");
}

v1::Scene scene_of(const Observation& observation) {
  v1::Scene scene;
  if (!scene.ParseFromString(observation.scene->bytes))
    throw Error(ErrorKind::kInternal, observation.name + ": its scene cannot be parsed");
  return scene;
}

Synthesize rendered_by(RenderPool& pool, std::stop_token stop) {
  return [&pool, stop](std::span<const SynthesisQuery> queries) {
    std::vector<RenderJob> jobs;
    for (const SynthesisQuery& query : queries) jobs.push_back(render_job(query));
    std::vector<Synthesis> syntheses;
    for (const v1::RenderGradReply& reply : pool.render_split(jobs, [&](double /*fraction*/) {
           if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
         })) {
      syntheses.push_back(to_synthesis(reply));
    }
    return syntheses;
  };
}

}  // namespace itn
