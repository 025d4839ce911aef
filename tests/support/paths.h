// Paths of the programs and files that tests use. Found from where the test is, not told to the
// compiler: what one clone compiled, another can use.
#pragma once

#include <filesystem>
#include <string>

namespace itn::testing {

// build/PRESET, with bin/ and share/ as if installed.
inline std::filesystem::path build_folder() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path();
}
// A file of the repository.
inline std::string source(const std::string& path) {
  return std::filesystem::read_symlink(build_folder() / "share/itn/models").parent_path() / path;
}

inline const std::string kItn = build_folder() / "bin/itn";
inline const std::string kItnLearn = build_folder() / "bin/itn-learn";
inline const std::string kItnWorker = build_folder() / "bin/itn-worker";
inline const std::string kItnPredictor = build_folder() / "bin/itn-predictor";

}  // namespace itn::testing
