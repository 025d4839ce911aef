// Photographs of one scene at several exposures, as one linear image.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace itn {

struct MergeOptions {
  std::vector<std::string> photographs;
  std::string output;
  std::vector<double> seconds;  // of each photograph; empty: as EXIF says
  std::string response = "estimate";
  std::optional<bool> is_linear;  // as of read_photograph()
};

void run_merge(const MergeOptions& options);

}  // namespace itn
