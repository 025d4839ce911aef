// Included before anything else where clang reads LibTorch's headers (ITN_FUZZ). These use vectors
// of c10::IValue before they define it, and clang instantiates constexpr functions, as in C++ 20
// those of vectors are in libstdc++ 12, where GCC does not yet need them: here they are not
// constexpr.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>

#undef _GLIBCXX20_CONSTEXPR
#define _GLIBCXX20_CONSTEXPR
#define __fill_a1 __fill_a1_of_bits  // the one function that is constexpr elsewhere
#include <vector>
#undef __fill_a1
#undef _GLIBCXX20_CONSTEXPR
#define _GLIBCXX20_CONSTEXPR constexpr
