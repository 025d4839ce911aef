#include "client/output.h"

#include <cerrno>
#include <system_error>

#include "common/error.h"

namespace itn {

std::string for_terminal(std::string_view text) {
  std::string result;
  for (size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const auto next = static_cast<unsigned char>(i + 1 < text.size() ? text[i + 1] : 0);
    // U+0080 to U+009F are control characters too; in UTF-8 they begin with C2.
    if (byte == 0xC2 && next >= 0x80 && next < 0xA0) {
      result += fmt::format("\\x{:02x}\\x{:02x}", byte, next);
      ++i;
    } else if ((byte < 0x20 && byte != '\n') || byte == 0x7F) {
      result += fmt::format("\\x{:02x}", byte);
    } else {
      result += text[i];
    }
  }
  return result;
}

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
