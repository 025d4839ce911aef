// Photographs of one scene at several exposures, as one linear image.
#pragma once

#include <string>
#include <vector>

namespace itn {

struct MergeOptions {
  std::vector<std::string> photographs;
  std::string output;
  std::vector<double> seconds;  // of each photograph; empty: as EXIF says
  std::string response = "estimate";
};

void run_merge(const MergeOptions& options);

}  // namespace itn
