// Whether LibTorch computes in bfloat16 here.
#pragma once

#include <cstdlib>
#include <string_view>

namespace itn::testing {

// False where the environment keeps oneDNN to instructions older than the processor's: Torch asks
// the processor alone, and oneDNN then fails. (A processor without them has Torch's own kernels.)
inline bool has_bfloat16() {
  const char* instructions = std::getenv("DNNL_MAX_CPU_ISA");
  return instructions == nullptr || std::string_view(instructions) == "ALL";
}

}  // namespace itn::testing
