#include "client/experiment/colours.h"

#include <utility>

#include <fmt/format.h>

#include "client/image/image.h"
#include "client/training/evaluation.h"
#include "common/random.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr std::array<const char*, kColours> kPlanes = {"R", "G", "B"};

// Branch of an item's seed, beside those of its images elsewhere (images.cpp).
constexpr uint64_t kColourBranch = 13;

}  // namespace

DatasetPlan colour_plan(DatasetPlan test, std::span<const uint32_t> chosen) {
  const auto items = std::exchange(*test.manifest.mutable_items(), {});
  const auto count = static_cast<size_t>(items.size());
  for (const uint32_t i : chosen) {
    for (size_t colour = 0; colour < kColours; ++colour) {
      const size_t other = (i + colour * count / kColours) % count;
      v1::DatasetItem& item = *test.manifest.add_items();
      item = items[static_cast<int>(i)];
      *item.mutable_material() = items[static_cast<int>(other)].material();
      item.set_seed(derive_seed(item.seed(), {kColourBranch, colour}));
      item.set_file(fmt::format("images/{:04}_{}.exr", i, kPlanes[colour]));
    }
  }
  return test;
}

ColourPicture input_colours(const DatasetReader& colours, size_t k) {
  ColourPicture picture;
  for (size_t colour = 0; colour < kColours; ++colour) {
    const auto item = static_cast<int>(k * kColours + colour);
    picture[colour] = colours.image(colours.manifest().items(item)).radiance;
  }
  return picture;
}

void render_colours(DatasetReader& colours, std::span<const Material> materials, uint32_t spp,
                    const fs::path& folder, const std::string& name, JobRenderer& pool,
                    std::stop_token stop) {
  fs::create_directories(folder / name);
  const size_t pictures = materials.size() / kColours;
  for (size_t k = 0; k < pictures; ++k) {
    if (fs::exists(colours_file(folder, name, k))) continue;
    Image image;
    image.width = image.height = colours.resolution();
    for (size_t colour = 0; colour < kColours; ++colour) {
      const size_t i = k * kColours + colour;
      const v1::DatasetItem& item = colours.manifest().items(static_cast<int>(i));
      image.channels[kPlanes[colour]] = rerender(colours, pool, item, materials[i], spp, stop);
    }
    write_exr(colours_file(folder, name, k), image);
  }
}

ColourPicture read_colours(const fs::path& folder, const std::string& name, size_t k) {
  const Image image = read_exr(colours_file(folder, name, k));
  ColourPicture picture;
  for (size_t colour = 0; colour < kColours; ++colour) {
    picture[colour] = image.channel(kPlanes[colour]);
  }
  return picture;
}

fs::path colours_file(const fs::path& folder, const std::string& name, size_t k) {
  return folder / name / fmt::format("colour_{:02}.exr", k);
}

}  // namespace itn
