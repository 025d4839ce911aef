// SIGTERM and SIGINT as something that a thread waits for.
#pragma once

namespace itn {

// Catches both signals from its construction on, whichever thread they are delivered to: libraries
// start threads of their own before main, which could not be told to block them. One at a time.
class ShutdownSignal {
 public:
  ShutdownSignal();

  // Blocks until a signal arrives that no earlier call has returned for.
  void wait();

  // A further signal, half a second from now or later, ends the process at once, whatever it does,
  // with a line on stderr and exit code 130.
  void exit_on_next();
};

}  // namespace itn
