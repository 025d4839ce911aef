#include "client/dataset/item_render.h"

#include <algorithm>
#include <utility>

#include "client/dataset/noise.h"
#include "client/render/render_query.h"
#include "client/render/shared_colours.h"
#include "common/random.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

// The branch of an item's seed for its pilot: not the random numbers of its image, nor of those it
// is compared with.
constexpr uint64_t kPilotBranch = 2;
// The branch for the renders of single colours, in which each has its own.
constexpr uint64_t kColourBranch = 3;

// Objects of datasets are so long, in mm.
constexpr double kLongestSide = 1;

std::vector<Material> colours_of(const v1::DatasetItem& item) {
  std::vector<Material> colours;
  for (const v1::Material& colour : item.colours()) colours.push_back(from_proto(colour));
  return colours;
}

}  // namespace

RenderJob render_job(std::shared_ptr<const SerializedScene> scene, const v1::DatasetItem& item,
                     uint32_t spp) {
  return job_of({.scene = std::move(scene),
                 .material = from_proto(item.material()),
                 .spp = spp,
                 .seed = item.seed()});
}

ItemRenders::ItemRenders(DatasetReader& dataset, const v1::DatasetItem& item) : item_(&item) {
  if (item.colours().empty() || shared_paths_pay(colours_of(item), kLongestSide)) {
    scenes_.push_back(dataset.scene(item));
    return;
  }
  for (const v1::Film::Channel colour : {v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE}) {
    scenes_.push_back(dataset.scene(item, colour));
  }
}

RenderJob ItemRenders::job(size_t number, uint32_t spp) const {
  if (item_->colours().empty()) return render_job(scenes_[number], *item_, spp);
  RenderQuery query{.scene = scenes_[number], .material = {}, .spp = spp, .seed = item_->seed()};
  if (count() == 1) {
    query.colours = colours_of(*item_);
  } else {
    query.material = from_proto(item_->colours(static_cast<int>(number)));
    query.seed = derive_seed(item_->seed(), {kColourBranch, number});
  }
  return job_of(query);
}

RenderJob ItemRenders::pilot(size_t number, const v1::NoiseTarget& target) const {
  RenderJob pilot = job(number, target.pilot_spp());
  pilot.request.set_seed(derive_seed(pilot.request.seed(), {kPilotBranch}));
  return pilot;
}

std::vector<v1::RenderGradReply> ItemRenders::by_channel(
    std::vector<v1::RenderGradReply> replies) const {
  if (item_->colours_size() <= static_cast<int>(count())) return replies;
  std::vector<v1::RenderGradReply> colours;
  for (int colour = 0; colour < item_->colours_size(); ++colour) {
    colours.push_back(reply_in_colour(replies.front(), colour));
  }
  return colours;
}

double relative_noise(const v1::RenderGradReply& reply) {
  const std::vector<float> mask = from_bytes<float>(reply.mask());
  const v1::Estimate& estimate = reply.estimates(0);
  if (estimate.colours().empty()) {
    return relative_noise(from_bytes<float>(estimate.radiance()),
                          from_bytes<float>(reply.standard_error()), mask);
  }
  double most = 0;
  for (int colour = 0; colour < estimate.colours_size(); ++colour) {
    most = std::max(most,
                    relative_noise(from_bytes<float>(estimate.colours(colour)),
                                   from_bytes<float>(reply.colour_standard_errors(colour)), mask));
  }
  return most;
}

}  // namespace itn
