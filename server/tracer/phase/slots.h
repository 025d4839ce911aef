// How many slots a phase function may have.
#pragma once

#include <cstddef>

namespace itn::tracer {

constexpr size_t kMaxPhaseSlots = 3;

}  // namespace itn::tracer
