#include "client/render/render_query.h"

#include "client/render/job_renderer.h"
#include "common/error.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"

namespace itn {

RenderJob job_of(const RenderQuery& query) {
  RenderJob job{.scene = query.scene, .request = {}};
  v1::RenderGradRequest& request = job.request;
  for (const Material& material : query.colours) *request.add_colours() = to_proto(material);
  if (query.colours.empty()) *request.mutable_material() = to_proto(query.material);
  if (query.phase) *request.mutable_phase() = *query.phase;
  request.set_spp(query.spp);
  request.set_seed(query.seed);
  request.set_estimates(query.estimates);
  request.set_pilot_spp(query.pilot_spp);
  request.set_pixels(query.pixels);
  request.set_tracer(query.tracer);
  for (const auto& [name, value] : query.values) set_value(request, name, value);
  for (const std::string& name : query.derivatives) request.add_parameters(name);
  if (!query.image.empty()) {
    request.mutable_loss()->set_image(to_bytes(query.image));
    request.mutable_loss()->set_weight(to_bytes(query.weight));
  }
  return job;
}

Render render_of(const v1::RenderGradReply& reply) {
  Render render;
  for (const v1::Estimate& estimate : reply.estimates()) {
    RenderEstimate& to = render.estimates.emplace_back();
    to.radiance = from_bytes<float>(estimate.radiance());
    for (const std::string& derivative : estimate.derivatives()) {
      to.derivatives.push_back(from_bytes<float>(derivative));
    }
  }
  render.mask = from_bytes<float>(reply.mask());
  render.loss = {reply.loss(), {reply.loss_gradient().begin(), reply.loss_gradient().end()}};
  render.cpu_seconds = reply.counters().cpu_seconds();
  return render;
}

Renderer rendered_by(JobRenderer& renderer, std::stop_token stop) {
  return [&renderer, stop](std::span<const RenderQuery> queries) {
    std::vector<RenderJob> jobs;
    for (const RenderQuery& query : queries) jobs.push_back(job_of(query));
    std::vector<Render> renders;
    for (const v1::RenderGradReply& reply : renderer.render_split(jobs, [&](double /*fraction*/) {
           if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
         })) {
      renders.push_back(render_of(reply));
    }
    return renders;
  };
}

}  // namespace itn
