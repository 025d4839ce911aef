// SIGTERM and SIGINT as something that a main function waits for.
#pragma once

namespace itn {

// Construct first thing in main: it blocks both signals in this thread and in those started later,
// so that only the calls below receive them.
class ShutdownSignal {
 public:
  ShutdownSignal();

  // Blocks until one of the signals arrives.
  void wait();

  // From now on a further signal ends the process at once, with exit code 130.
  void exit_on_next();
};

}  // namespace itn
