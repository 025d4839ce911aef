#include "client/files/folder_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <string>
#include <system_error>

#include "common/error.h"

namespace itn {
namespace fs = std::filesystem;

std::vector<fs::path> files_with(std::initializer_list<std::string_view> extensions,
                                 const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    std::string extension = entry.path().extension().string();
    std::ranges::transform(extension, extension.begin(),
                           [](unsigned char c) { return std::tolower(c); });
    if (entry.is_regular_file() && std::ranges::count(extensions, extension) > 0) {
      files.push_back(entry.path());
    }
  }
  if (error) {
    throw Error(ErrorKind::kIo,
                fmt::format("cannot read {}: {}", folder.string(), error.message()));
  }
  std::ranges::sort(files);
  return files;
}

}  // namespace itn
