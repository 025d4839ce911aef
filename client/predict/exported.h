// Predictions as materials of renderers.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "client/exports/exports.h"
#include "client/predict/printer.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// The file of a format, of a prediction with channels: its best guesses, which are those of one Y
// or of R, G and B. Of `options` the object's size and provenance are the prediction's.
std::string exported(const v1::Prediction& prediction, const ExportFormat& format,
                     ExportOptions options);

// The file for an image's material in a folder.
std::filesystem::path exported_file(const std::filesystem::path& folder, const std::string& image,
                                    const ExportFormat& format);

struct ExportTarget {
  // Standard output if it is empty; a folder, which is there, for a file of each image's name.
  std::filesystem::path path;
  bool is_folder = false;
  bool combined_alone = false;  // of several images of one material what they say together
};

// Writes predictions in a format as they come. What limits how far they can be trusted goes to the
// log, as do images that could not be used.
std::unique_ptr<PredictionPrinter> export_printer(const ExportFormat& format, ExportOptions options,
                                                  ExportTarget target);

}  // namespace itn
