// The renders that make the image of a dataset's item.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/render/render_job.h"
#include "common/scene/scene_bytes.h"

namespace itn {

// The render of an item with one channel: of the object alone, as a network does not see the floor.
RenderJob render_job(std::shared_ptr<const SerializedScene> scene, const v1::DatasetItem& item,
                     uint32_t spp);

// What is rendered for any item: in colour one image whose colours share their paths, or one for
// each colour, whichever costs less.
class ItemRenders {
 public:
  ItemRenders() = default;
  // Throws Error as DatasetReader::scene().
  ItemRenders(DatasetReader& dataset, const v1::DatasetItem& item);

  size_t count() const { return scenes_.size(); }

  // The render `number` below count(), of so many samples a pixel.
  RenderJob job(size_t number, uint32_t spp) const;

  // The coarse render by which its samples are chosen (noise.h), with random numbers of its own.
  RenderJob pilot(size_t number, const v1::NoiseTarget& target) const;

  // What their replies say of each channel of the image.
  std::vector<v1::RenderGradReply> by_channel(std::vector<v1::RenderGradReply> replies) const;

 private:
  const v1::DatasetItem* item_ = nullptr;
  std::vector<std::shared_ptr<const SerializedScene>> scenes_;
};

// The noise of a reply's image; of several colours that of the noisiest.
double relative_noise(const v1::RenderGradReply& reply);

}  // namespace itn
