// What the fuzz targets have in common. A target is one source with LLVMFuzzerTestOneInput(), which
// gives an input to a part of the program and ends the process where that does what it must not.
// It runs under libFuzzer (preset `fuzz`), or over its corpus by run_corpus.cpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "common/error.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace itn::testing {

// Inputs, or ways to read them, that were not refused: a corpus file that is refused leads nowhere.
inline uint64_t accepted = 0;

[[noreturn]] inline void fail(const std::string& reason) {
  std::fprintf(stderr, "%s\n", reason.c_str());
  std::abort();
}

// Calls what reads an input. To refuse it is an answer, unless the message says that the fault is
// ours; any other exception ends the process.
template <typename F>
void expect_answer(const F& read) {
  try {
    read();
    ++accepted;
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kInternal) fail(error.what());
  }
}

inline std::string to_string(const uint8_t* data, size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

}  // namespace itn::testing
