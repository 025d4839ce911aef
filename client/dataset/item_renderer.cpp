#include "client/dataset/item_renderer.h"

#include <utility>

#include "client/dataset/dataset_render.h"
#include "client/dataset/noise.h"

namespace itn {

ItemRenderer::ItemRenderer(const v1::DatasetConfig& config, RenderPool& pool, Source source)
    : config_(config), pool_(pool), source_(std::move(source)) {}

// Workers may join and leave.
size_t ItemRenderer::ahead() const {
  return 2 * static_cast<size_t>(pool_.parallelism()) + 1;
}

std::optional<ItemRenderer::Rendered> ItemRenderer::next(const Wait& wait) {
  while (pending_.size() < ahead() && submit_next(wait)) {
  }
  if (pending_.empty()) return std::nullopt;
  Pending front = std::move(pending_.front());
  pending_.pop_front();
  return Rendered{front.work.number, std::move(front.work.item), front.spp, wait(front.reply)};
}

std::optional<ItemRenderer::Work> ItemRenderer::take() {
  if (exhausted_) return std::nullopt;
  std::optional<Work> work = source_();
  exhausted_ = !work;
  return work;
}

bool ItemRenderer::submit_next(const Wait& wait) {
  if (!config_.has_noise()) {
    std::optional<Work> work = take();
    if (!work) return false;
    submit(std::move(*work), config_.spp());
    return true;
  }
  while (pilots_.size() < ahead()) {
    std::optional<Work> work = take();
    if (!work) break;
    RenderJob pilot = pilot_job(work->scene, work->item, config_.noise());
    pilots_.push_back({std::move(*work), 0, pool_.submit(std::move(pilot))});
  }
  if (pilots_.empty()) return false;
  Pending pilot = std::move(pilots_.front());
  pilots_.pop_front();
  const double noise = relative_noise(wait(pilot.reply));
  submit(std::move(pilot.work), spp_for(config_.noise(), noise));
  return true;
}

void ItemRenderer::submit(Work work, uint32_t spp) {
  RenderJob job = render_job(work.scene, work.item, spp);
  for (const double albedo : work.albedos) {
    job.request.add_albedos(albedo);
  }
  if (config_.derivatives()) ask_for_derivatives(job);
  work.scene.reset();  // the job has it
  pending_.push_back({std::move(work), spp, pool_.submit(std::move(job))});
}

}  // namespace itn
