// Ctrl-C, and SIGTERM: the first asks the command to stop where it can be resumed, a second one
// ends the process at once.
#pragma once

#include <stop_token>

namespace itn {

// Once, first thing in main.
void watch_interrupts();

// Its stop is requested by the first signal.
std::stop_token interruption();

// Throws Error (kCancelled) after the first signal.
void throw_if_interrupted();

}  // namespace itn
