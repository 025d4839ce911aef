// Images of shapes that nobody has seen, rendered while a network learns from those before.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "client/dataset/dataset.h"
#include "client/dataset/item_renderer.h"
#include "client/dataset/plan.h"
#include "client/render_pool/render_pool.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

struct StreamedImage {
  uint64_t number = 0;
  v1::DatasetItem item;
  DatasetImage image;
};

// The panoramas of a stream, if they are one of its lights.
struct StreamPanoramas {
  PanoramaSplit names;                       // all are of the training
  std::map<std::string, v1::Pixels> pixels;  // by name, as scene_of() takes them
};

// An endless sequence of images of random shapes: image `number` is a function of the configuration
// and its number alone, whatever was rendered before and by how many workers.
//
// Making a shape costs as much as an image or two, so that kImagesOfShape images have one each on
// average, drawn from the kShapesAtATime shapes that are current: one leaves and a new one comes
// after every kImagesOfShape images.
class RenderStream {
 public:
  static constexpr uint64_t kShapesAtATime = 32;
  static constexpr uint64_t kImagesOfShape = 12;

  // `config`: with all defaults, random shapes, and all images for training. Begins to render at
  // once, from the image `first`. The pool must outlive it. Throws Error, of panoramas, as
  // load_panorama_set().
  RenderStream(const v1::DatasetConfig& config, RenderPool& pool, uint64_t first);
  // Waits for the renders that are under way.
  ~RenderStream();
  RenderStream(const RenderStream&) = delete;
  RenderStream& operator=(const RenderStream&) = delete;

  // The next image. Throws Error: kCancelled soon after a stop is requested, and whatever becomes
  // of a render.
  StreamedImage next(const std::stop_token& stop);

 private:
  void run(const std::stop_token& stop);
  ItemRenderer::Work work(uint64_t number);
  const v1::Triangles& triangles(uint64_t shape);

  v1::DatasetConfig config_;
  StreamPanoramas panoramas_;
  RenderPool& pool_;
  uint64_t next_number_;
  std::map<uint64_t, v1::Triangles> shapes_;  // those that are current

  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<StreamedImage> ready_;
  std::exception_ptr failure_;

  std::jthread thread_;  // the last: it uses all of the above
};

// The set of random shapes (random_shape.h) that a stream is of: no dataset has any of them.
uint64_t stream_shapes(const v1::DatasetConfig& config);
// The item of this number in the stream, and the number of its shape.
v1::DatasetItem stream_item(const v1::DatasetConfig& config, uint64_t number,
                            const PanoramaSplit& panoramas = {});
uint64_t stream_shape(const v1::DatasetConfig& config, uint64_t number);

}  // namespace itn
