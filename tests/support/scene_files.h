// Scene files of tests.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "tests/support/temporary_folder.h"

namespace itn::testing {

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
