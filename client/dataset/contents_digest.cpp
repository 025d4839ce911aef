#include "client/dataset/contents_digest.h"

#include <fmt/format.h>

#include <variant>

#include "common/image/attributes.h"
#include "common/rpc/wire_array.h"
#include "common/scene/scene_bytes.h"

namespace itn {

std::string contents_digest(const Image& image) {
  std::string all = fmt::format("{} {}", image.width, image.height);
  for (const auto& [name, plane] : image.channels) all += " " + name + " " + to_bytes(plane);
  for (const auto& [name, value] : image.attributes) {
    if (name == attribute::kContents) continue;
    all += std::visit([&](const auto& v) { return fmt::format(" {} {}", name, v); }, value);
  }
  return to_hex(sha256(all));
}

}  // namespace itn
