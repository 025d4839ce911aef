#include "client/page/page.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <fmt/format.h>

#include "client/output.h"
#include "client/page/page_frame.h"

namespace itn {
namespace {

std::string base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string result;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const size_t count = std::min<size_t>(3, bytes.size() - i);
    uint32_t group = 0;
    for (size_t k = 0; k < 3; ++k) {
      group = group << 8 | (k < count ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    }
    for (size_t k = 0; k < 4; ++k) {
      result += k <= count ? kDigits[group >> (18 - 6 * k) & 63] : '=';
    }
  }
  return result;
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : for_terminal(text)) {
    switch (c) {
      case '&': result += "&amp;"; break;
      case '<': result += "&lt;"; break;
      case '>': result += "&gt;"; break;
      case '"': result += "&quot;"; break;
      case '\'': result += "&#39;"; break;
      default: result += c;
    }
  }
  return result;
}

std::string data_url(std::string_view png) {
  return "data:image/png;base64," + base64(png);
}

std::string figure(const Panel& panel, std::string_view kind, std::string_view caption) {
  return fmt::format(
      "<figure class=\"{}\"><img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{}\"><figcaption>{}"
      "</figcaption></figure>\n",
      kind, data_url(encode_png(panel)), panel.side, panel.side, caption, caption);
}

std::string page(std::string_view title, std::string_view body, std::string_view script,
                 std::string_view more_style) {
  return fmt::format(kReportPage, fmt::arg("title", escaped(title)),
                     fmt::arg("style", fmt::format("{}{}", kReportStyle, more_style)),
                     fmt::arg("body", body), fmt::arg("script", script));
}

}  // namespace itn
