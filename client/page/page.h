// Pages for people: one HTML file each, which loads nothing.
#pragma once

#include <string>
#include <string_view>

#include "client/panels.h"

namespace itn {

// As the text of an element or a quoted attribute, without control characters.
std::string escaped(std::string_view text);

// Of the bytes of a PNG file, as what `src` names (RFC 4648, RFC 2397).
std::string data_url(std::string_view png);

// `kind`: its class in the style; `caption` is HTML.
std::string figure(const Panel& panel, std::string_view kind, std::string_view caption);

// Our frame and style with this title, which is text, and body, which is HTML. `more_style`: CSS
// after ours. `script` may be empty.
std::string page(std::string_view title, std::string_view body, std::string_view script = "",
                 std::string_view more_style = "");

}  // namespace itn
