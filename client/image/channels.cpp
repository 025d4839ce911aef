#include "client/image/channels.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <set>

#include "common/error.h"
#include "common/printable.h"

namespace itn {
namespace {

// "env.R" is channel R of layer "env"; the default layer has no name.
std::string layer_of(const std::string& channel) {
  const size_t dot = channel.rfind('.');
  return dot == std::string::npos ? "" : channel.substr(0, dot);
}

std::string in_layer(const std::string& layer, const char* channel) {
  return layer.empty() ? channel : fmt::format("{}.{}", layer, channel);
}

bool is_mask(const std::string& channel) {
  return channel == "mask" || layer_of(channel) == "mask";
}

// Empty: none in this layer.
std::vector<std::string> radiance_in(const Image& image, const std::string& layer) {
  const std::vector<std::string> rgb = {in_layer(layer, "R"), in_layer(layer, "G"),
                                        in_layer(layer, "B")};
  if (std::ranges::all_of(rgb, [&](const auto& name) { return image.has(name); })) return rgb;
  // Y beside X and Z is a coordinate.
  const bool is_vector = image.has(in_layer(layer, "X")) && image.has(in_layer(layer, "Z"));
  for (const char* gray : {"Y", "L"}) {
    if (!is_vector && image.has(in_layer(layer, gray))) return {in_layer(layer, gray)};
  }
  return {};
}

// Blender's name for the picture, beside its other passes.
bool is_combined(const std::string& layer) {
  return layer == "Combined" || layer.ends_with(".Combined");
}

Error unclear(const Image& image, const std::string& name, const std::string& wanted) {
  return invalid_input(
      fmt::format("{} has the channels {}; {}", name, image.channel_names(), wanted));
}

}  // namespace

std::vector<std::string> radiance_channels(const Image& image, const std::string& name,
                                           const std::string& wanted_layer,
                                           const std::string& recovery_hint) {
  if (!wanted_layer.empty()) {
    if (auto found = radiance_in(image, wanted_layer); !found.empty()) return found;
    throw unclear(
        image, name,
        fmt::format("there is no layer {} with R, G and B, or Y", printable(wanted_layer)));
  }
  if (const auto found = radiance_in(image, ""); !found.empty()) return found;
  std::set<std::string> layers;
  std::vector<std::string> colours;  // neither mask nor alpha
  for (const auto& [channel, plane] : image.channels) {
    const std::string layer = layer_of(channel);
    if (is_mask(channel) || channel == alpha_beside(channel)) continue;
    colours.push_back(channel);
    if (!radiance_in(image, layer).empty()) layers.insert(layer);
  }
  if (layers.size() == 1) return radiance_in(image, *layers.begin());
  if (std::ranges::count_if(layers, is_combined) == 1) {
    return radiance_in(image, *std::ranges::find_if(layers, is_combined));
  }
  if (layers.empty() && colours.size() == 1) {
    spdlog::warn("{}: its only channel, {}, is taken for the radiance", name, colours.front());
    return colours;
  }
  throw unclear(image, name,
                layers.size() > 1 ? fmt::format("which of the layers {} is meant? {}",
                                                fmt::join(layers, ", "), recovery_hint)
                                  : "wanted are R, G and B, or Y, or L, or one channel alone");
}

std::string alpha_beside(const std::string& channel) {
  return in_layer(layer_of(channel), "A");
}

std::string mask_channel(const Image& image, const std::string& name) {
  for (const char* channel : {"mask.Y", "mask", "Y", "L", "R", "A"}) {
    if (image.has(channel)) return channel;
  }
  if (image.channels.size() == 1) return image.channels.begin()->first;
  throw unclear(image, name, "a mask has one of mask.Y, Y, L, R and A, or one channel alone");
}

}  // namespace itn
