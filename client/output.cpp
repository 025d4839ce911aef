#include "client/output.h"

#include <cerrno>
#include <system_error>

#include "common/error.h"

namespace itn {

void print_result(std::string_view text, std::FILE* out) {
  const std::string shown = for_terminal(text);
  std::fwrite(shown.data(), 1, shown.size(), out);  // a failure stays for finish_output()
}

void finish_output() {
  errno = 0;
  const bool failed_before = std::ferror(stdout) != 0;
  if (std::fflush(stdout) == 0 && !failed_before) return;
  const std::string reason = errno == 0 ? "it is full or closed"
                                        : std::error_code(errno, std::generic_category()).message();
  throw Error(ErrorKind::kIo, "cannot write the result to standard output: " + reason);
}

}  // namespace itn
