// What itn fit found, as a page for people.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "client/predict/swatches.h"
#include "itn/v1/refine.pb.h"

namespace itn {

// One HTML file that needs nothing else. Of the folder, its pictures are in the page (pose.png,
// picture.png), and a chart of its iterations (curves.png), which is written. `title` is text.
// Throws Error (kIo, data loss) if one cannot be read or written.
std::string fit_report_page(const std::string& title, const v1::FitResult& result,
                            const std::filesystem::path& folder, std::span<const Swatch> swatches);

}  // namespace itn
