// A folder of a test, and scene files in it.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace itn::testing {

// Empty, of this process and test alone; removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder()
      : path_(std::filesystem::temp_directory_path() / ("itn-test-" + std::to_string(getpid()))) {
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::string path(const std::string& name) const { return path_ / name; }

  // Writes a file; its path.
  std::string write(const std::string& name, const std::string& content) const {
    std::ofstream(path(name), std::ios::binary) << content;
    return path(name);
  }

 private:
  std::filesystem::path path_;
};

// A cube under a constant light, as a scene file.
inline const char* const kSceneFile = R"(# A cube
object { mesh { builtin: "cube" } }
surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } }
lights { constant { radiance: 1 } }
camera { origin { y: 1.5 z: -4 } target { y: 0.5 } fov_degrees: 22 }
film { width: 16 height: 12 }
)";

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

}  // namespace itn::testing
