#include "client/training/rerendering_loss.h"

#include <future>

#include "client/render/job_renderer.h"

namespace itn {

RerenderingEvaluator pool_rerendering(JobRenderer& pool, const RerenderingSettings& settings,
                                      std::stop_token stop) {
  return [&pool, settings, stop](std::span<const RenderQuery> queries) {
    std::vector<std::future<v1::RenderGradReply>> replies;
    for (RenderQuery query : queries) {
      query.spp = settings.spp;
      query.estimates = settings.estimates;
      query.pilot_spp = settings.pilot_spp;
      query.derivatives.assign(kMaterialParameters.begin(), kMaterialParameters.end());
      replies.push_back(pool.submit(job_of(query)));
    }
    std::vector<LossWithGradient> losses;
    for (auto& future : replies) {
      losses.push_back(render_of(wait_for_render(future, stop)).loss);
    }
    return losses;
  };
}

}  // namespace itn
