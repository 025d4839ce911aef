// A trained model as a file for prediction.
#pragma once

#include <optional>
#include <string>

namespace itn {

struct ModelExportOptions {
  std::string checkpoint;
  std::string output;
  std::string name, version;
  std::string dataset;
  std::optional<double> error_correlation;
};

void run_export(const ModelExportOptions& options);

}  // namespace itn
