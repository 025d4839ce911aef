#include "client/exports/exports.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <vector>

#include "common/error.h"
#include "common/printable.h"

namespace itn {
namespace {

constexpr std::array<ExportFormat, 5> kFormats{{
    {"mitsuba", ".xml", "Mitsuba 3: homogeneous medium and its boundary; exact", to_mitsuba},
    {"pbrt", ".pbrt", "pbrt-v4: named homogeneous medium; exact for gray materials", to_pbrt},
    {"blender", ".py", "Blender: script that makes a material with a volume, exact in Cycles",
     to_blender},
    {"arnold", ".ass", "Arnold: standard_surface with transmission and scattering", to_arnold},
    {"openpbr", ".mtlx", "MaterialX: OpenPBR surfaces, by subsurface or by transmission",
     to_openpbr},
}};

}  // namespace

std::span<const ExportFormat> export_formats() {
  return kFormats;
}

const ExportFormat& export_format(std::string_view name) {
  const auto* found = std::ranges::find(kFormats, name, &ExportFormat::name);
  if (found == kFormats.end()) {
    std::vector<std::string_view> names;
    names.reserve(kFormats.size());
    for (const ExportFormat& format : kFormats) names.push_back(format.name);
    throw Error(ErrorKind::kUsage, fmt::format("there is no export format {}; there are {}",
                                               printable(name), fmt::join(names, ", ")));
  }
  return *found;
}

void require_own_suffix(const ExportFormat& format, const std::filesystem::path& file) {
  const std::string suffix = file.extension().string();
  if (suffix == format.extension) return;
  const auto* other = std::ranges::find(kFormats, suffix, &ExportFormat::extension);
  if (other == kFormats.end()) return;
  throw Error(ErrorKind::kUsage,
              fmt::format("{}: files of --format {} are named {}; {} are those of {}",
                          file.string(), format.name, format.extension, suffix, other->name));
}

}  // namespace itn
