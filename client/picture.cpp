#include "client/picture.h"

#include "client/panels.h"
#include "common/image/preview.h"

namespace itn {
namespace {

PanelRow panels(const Comparison& comparison, int resolution) {
  const float white = white_level(comparison.input);
  PanelRow result(3, {.side = resolution, .pixels = {}});
  for (size_t p = 0; p < comparison.input.size(); ++p) {
    const float input = comparison.input[p] / white;
    const float rendered = comparison.rendered[p] / white;
    result[0].pixels.push_back(gray(input));
    result[1].pixels.push_back(gray(rendered));
    result[2].pixels.push_back(diverging(rendered - input));
  }
  return result;
}

}  // namespace

void write_comparison(const std::filesystem::path& path, int resolution,
                      std::span<const Comparison> rows) {
  std::vector<PanelRow> result;
  for (const Comparison& row : rows) result.push_back(panels(row, resolution));
  write_panels(path, result);
}

}  // namespace itn
