#include "common/printable.h"

#include <fmt/format.h>

namespace itn {

std::string printable(std::string_view text, size_t most) {
  std::string result;
  for (const char c : text.substr(0, most)) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\\') {
      result += "\\\\";
    } else if (byte < 0x20 || byte >= 0x7f) {
      result += fmt::format("\\x{:02x}", byte);
    } else {
      result += c;
    }
  }
  return text.size() > most ? result + "..." : result;
}

}  // namespace itn
