// Text of strangers, made fit to be shown.
#pragma once

#include <string>
#include <string_view>

namespace itn {

// The text with control characters and bytes that are not ASCII as \xNN and backslashes doubled, so
// that it is one line and cannot steer a terminal; what is beyond `most` bytes of it is replaced by
// "...". For names and values that come from a file or over the wire, in messages and logs.
std::string printable(std::string_view text, size_t most = 80);

// With control characters as \xNN, line ends left as they are: lines that cannot steer a terminal.
std::string for_terminal(std::string_view text);

}  // namespace itn
