// A wait that the user can cut short.
#pragma once

#include <chrono>

namespace itn {

// Waits so long, or until the first signal (interrupt.h); whether there was one.
bool interrupted_within(std::chrono::duration<double> time);

}  // namespace itn
