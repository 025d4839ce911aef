#include "common/scene/panorama_file.h"

#include <cstdint>
#include <string>
#include <vector>

#include "common/image/channels.h"
#include "common/image/image.h"
#include "common/rpc/wire_array.h"

namespace itn {

v1::Pixels load_panorama(const std::filesystem::path& path) {
  const Image image = read_exr(path);
  const std::vector<std::string> channels = radiance_channels(image, path.string());
  const auto plane = [&](size_t colour) -> const std::vector<float>& {
    return image.channel(channels[channels.size() == 1 ? 0 : colour]);
  };
  const auto &r = plane(0), &g = plane(1), &b = plane(2);
  std::vector<float> rgb;
  rgb.reserve(3 * r.size());
  for (size_t i = 0; i < r.size(); ++i) rgb.insert(rgb.end(), {r[i], g[i], b[i]});
  v1::Pixels pixels;
  pixels.set_width(static_cast<uint32_t>(image.width));
  pixels.set_height(static_cast<uint32_t>(image.height));
  pixels.set_rgb(to_bytes(rgb));
  return pixels;
}

}  // namespace itn
