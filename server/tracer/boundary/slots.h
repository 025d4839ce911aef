// How many slots a boundary may have.
#pragma once

#include <cstddef>

namespace itn::tracer {

constexpr size_t kMaxBoundarySlots = 2;

}  // namespace itn::tracer
