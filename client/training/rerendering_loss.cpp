#include "client/training/rerendering_loss.h"

#include <future>

#include "client/render_pool/render_pool.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

RenderJob render_job(const RerenderingQuery& query, const RerenderingSettings& settings) {
  RenderJob job;
  job.scene = query.scene;
  *job.request.mutable_material() = to_proto(query.material);
  job.request.set_spp(settings.spp);
  job.request.set_seed(query.seed);
  job.request.set_estimates(settings.estimates);
  job.request.set_pilot_spp(settings.pilot_spp);
  job.request.set_pixels(v1::OBJECT_PIXELS);
  for (const v1::Parameter parameter : {v1::SIGMA_T, v1::ALBEDO, v1::G}) {
    job.request.add_derivatives(parameter);
  }
  job.request.mutable_loss()->set_image(to_bytes(query.image));
  job.request.mutable_loss()->set_weight(to_bytes(query.weight));
  return job;
}

}  // namespace

RerenderingEvaluator pool_rerendering(RenderPool& pool, const RerenderingSettings& settings,
                                      std::stop_token stop) {
  return [&pool, settings, stop](std::span<const RerenderingQuery> queries) {
    std::vector<std::future<v1::RenderGradReply>> replies;
    for (const RerenderingQuery& query : queries) {
      replies.push_back(pool.submit(render_job(query, settings)));
    }
    std::vector<tracer::LossWithGradient> losses;
    for (auto& future : replies) {
      const v1::RenderGradReply reply = wait_for_render(future, stop);
      losses.push_back(
          {reply.loss(), {reply.loss_gradient(0), reply.loss_gradient(1), reply.loss_gradient(2)}});
    }
    return losses;
  };
}

}  // namespace itn
