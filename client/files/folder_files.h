// What is in a folder.
#pragma once

#include <filesystem>
#include <initializer_list>
#include <string_view>
#include <vector>

namespace itn {

// The regular files in the folder (not its subfolders) whose extension is one of these, in lower or
// upper case, in the order of their names: e.g. {".ply", ".obj"}. Throws Error (kIo).
std::vector<std::filesystem::path> files_with(std::initializer_list<std::string_view> extensions,
                                              const std::filesystem::path& folder);

}  // namespace itn
