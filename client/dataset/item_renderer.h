// Rendering the images of items one after the other, with as many samples as the configuration
// says.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "common/scene/scene_bytes.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// Each image after its pilot if there is a noise target, with enough of both under way that no
// worker is ever idle. What it renders does not depend on when.
class ItemRenderer {
 public:
  struct Work {
    uint64_t number = 0;  // the caller's, for knowing it again
    v1::DatasetItem item;
    std::shared_ptr<const SerializedScene> scene;
    std::vector<double> albedos;  // below the item's: images of these from the same paths
  };

  struct Rendered {
    uint64_t number = 0;
    v1::DatasetItem item;
    uint32_t spp = 0;
    v1::RenderGradReply reply;
  };

  // What to render next; nothing after the last.
  using Source = std::function<std::optional<Work>()>;
  // Waits for a render, and throws what became of it.
  using Wait = std::function<v1::RenderGradReply(std::future<v1::RenderGradReply>&)>;

  // The configuration is one with all defaults. The pool must outlive it.
  ItemRenderer(const v1::DatasetConfig& config, RenderPool& pool, Source source);

  // The images in the order of the source; nothing after the last. Throws what source and wait do.
  std::optional<Rendered> next(const Wait& wait);

 private:
  struct Pending {
    Work work;
    uint32_t spp = 0;
    std::future<v1::RenderGradReply> reply;
  };

  size_t ahead() const;
  std::optional<Work> take();
  bool submit_next(const Wait& wait);
  void submit(Work work, uint32_t spp);

  v1::DatasetConfig config_;
  RenderPool& pool_;
  Source source_;
  bool exhausted_ = false;
  std::deque<Pending> pilots_, pending_;
};

}  // namespace itn
