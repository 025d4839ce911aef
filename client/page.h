// Pages for people: one HTML file that needs nothing else and loads nothing.
#pragma once

#include <string>
#include <string_view>

namespace itn {

// Text from elsewhere, as that of an element or a quoted attribute, without control characters.
std::string html_escaped(std::string_view text);

// The bytes of a PNG file in a figure. `kind`: its class in the style (client/page_frame.h);
// `attributes` of the image are empty or begin with a space; `caption` is HTML.
std::string html_figure(std::string_view png, std::string_view kind, std::string_view attributes,
                        std::string_view caption);

// `title` is text, `body` HTML.
std::string html_page(std::string_view title, std::string_view body);

}  // namespace itn
