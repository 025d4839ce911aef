#include "client/training/render_stream.h"

#include <utility>

#include <spdlog/spdlog.h>

#include "client/dataset/dataset_render.h"
#include "client/dataset/item_scene.h"
#include "client/dataset/noise.h"
#include "client/dataset/panorama_set.h"
#include "client/render_pool/render_wait.h"
#include "common/error.h"
#include "common/geometry/random_shape.h"
#include "common/random.h"
#include "common/rpc/wire_array.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace {

// Branches of the tree of random choices below a stream's seeds.
enum StreamChoice : uint64_t { kCurrentShape = 1, kShapes };

// Images that wait to be taken: enough that a trainer finds some whenever it looks.
constexpr size_t kMaxReady = 64;

DatasetImage image_of(const ItemRenderer::Rendered& rendered) {
  const v1::RenderGradReply& reply = rendered.reply;
  return {.radiance = from_bytes<float>(reply.estimates(0).radiance()),
          .mask = from_bytes<float>(reply.mask()),
          .standard_error = from_bytes<float>(reply.standard_error()),
          .spp = rendered.spp};
}

StreamPanoramas load_panoramas(const v1::DatasetConfig& config) {
  const PanoramaSet set = panorama_set(config);
  for (const std::string& message : set.refused) spdlog::warn("not used: {}", message);
  StreamPanoramas result{.names = split_panoramas(config, set.panoramas), .pixels = {}};
  for (const Panorama& panorama : set.panoramas) {
    result.pixels[panorama.name].ParseFromString(panorama.to_file());
  }
  return result;
}

}  // namespace

uint64_t stream_shape(const v1::DatasetConfig& config, uint64_t number) {
  SplitMix random(derive_seed(config.seed(), {kCurrentShape, number}));
  return number / RenderStream::kImagesOfShape + random.below(RenderStream::kShapesAtATime);
}

uint64_t stream_shapes(const v1::DatasetConfig& config) {
  return derive_seed(config.shapes().random().seed(), {kShapes});
}

v1::DatasetItem stream_item(const v1::DatasetConfig& config, uint64_t number,
                            const PanoramaSplit& panoramas) {
  ShapeSplit only;
  only.train.push_back(random_shape_name(stream_shapes(config), stream_shape(config, number)));
  return plan_item(config, only, number, panoramas);
}

RenderStream::RenderStream(const v1::DatasetConfig& config, RenderPool& pool, uint64_t first)
    : config_(config), panoramas_(load_panoramas(config)), pool_(pool), next_number_(first) {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

RenderStream::~RenderStream() = default;

StreamedImage RenderStream::next(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait(lock, stop, [this] { return !ready_.empty() || failure_; })) {
    throw Error(ErrorKind::kCancelled, "interrupted");
  }
  if (ready_.empty()) std::rethrow_exception(failure_);
  StreamedImage image = std::move(ready_.front());
  ready_.pop_front();
  changed_.notify_all();
  return image;
}

void RenderStream::run(const std::stop_token& stop) {
  try {
    ItemRenderer renderer(config_, pool_, [this] { return work(next_number_++); });
    const auto wait = [&](std::future<v1::RenderGradReply>& reply) {
      return wait_for_render(reply, stop);
    };
    while (const auto rendered = renderer.next(wait)) {
      StreamedImage image{rendered->number, rendered->item, image_of(*rendered)};
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return ready_.size() < kMaxReady; })) return;
      ready_.push_back(std::move(image));
      changed_.notify_all();
    }
  } catch (...) {
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    changed_.notify_all();
  }
}

ItemRenderer::Work RenderStream::work(uint64_t number) {
  v1::DatasetItem item = stream_item(config_, number, panoramas_.names);
  const auto panorama = panoramas_.pixels.find(item.light().panorama().name());
  auto scene =
      serialize(scene_of(item, triangles(stream_shape(config_, number)), config_.resolution(),
                         panorama == panoramas_.pixels.end() ? nullptr : &panorama->second));
  return {number, std::move(item), std::move(scene), {}};
}

const v1::Triangles& RenderStream::triangles(uint64_t shape) {
  // Those before the current ones are not needed any more.
  shapes_.erase(shapes_.begin(), shapes_.lower_bound(next_number_ / kImagesOfShape));
  const auto [place, is_new] = shapes_.try_emplace(shape);
  if (is_new) {
    v1::Mesh mesh;
    set_triangles(mesh, random_shape(random_shape_seed(stream_shapes(config_), shape)));
    place->second = std::move(*mesh.mutable_triangles());
  }
  return place->second;
}

}  // namespace itn
