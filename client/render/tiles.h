// An image in rectangles, so that many workers share it and none holds more than its own.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "client/render/render_job.h"
#include "itn/v1/render.pb.h"

namespace itn {

// The pixels that a job asks for: its tile, or the whole film.
v1::Tile pixels_of(const RenderJob& job);

// Cuts a rectangle into tiles of about equal size that cover it without overlap, row by row. They
// follow from its size and the samples per pixel alone: images after a pilot depend on the tiles,
// and must not depend on who renders them. At most `most` of them are on a side.
std::vector<v1::Tile> tiles_of(const v1::Tile& whole, uint32_t spp,
                               uint32_t most = std::numeric_limits<uint32_t>::max());

// Puts the answers for tiles into one.
class TiledReply {
 public:
  explicit TiledReply(const v1::Tile& whole) : whole_(whole) {}

  // The answer to `tile` of the whole, as the check of replies has let it pass.
  void add(const v1::Tile& tile, const v1::RenderGradReply& part);

  // When all have been added.
  v1::RenderGradReply take() { return std::move(reply_); }

 private:
  using Images = google::protobuf::RepeatedPtrField<std::string>;
  void copy(const v1::Tile& tile, const Images& parts, Images& images) const;
  void copy(const v1::Tile& tile, const std::string& part, std::string& image) const;

  const v1::Tile whole_;
  v1::RenderGradReply reply_;
};

// Adds up the counters of several replies.
void add_counters(const v1::Counters& from, v1::Counters& to);

}  // namespace itn
