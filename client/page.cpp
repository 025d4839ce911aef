#include "client/page.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include "client/output.h"
#include "client/page_frame.h"

namespace itn {
namespace {

std::string base64(std::string_view bytes) {
  std::string result(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int size = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(result.data()),
                                   reinterpret_cast<const unsigned char*>(bytes.data()),
                                   static_cast<int>(bytes.size()));
  result.resize(static_cast<size_t>(size));
  return result;
}

}  // namespace

std::string html_escaped(std::string_view text) {
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

std::string html_figure(std::string_view png, std::string_view kind, std::string_view attributes,
                        std::string_view caption) {
  return fmt::format(
      "<figure class=\"{}\"><img src=\"data:image/png;base64,{}\"{} alt=\"{}\">"
      "<figcaption>{}</figcaption></figure>\n",
      kind, base64(png), attributes, caption, caption);
}

std::string html_page(std::string_view title, std::string_view body) {
  return fmt::format(kReportPage, fmt::arg("title", html_escaped(title)),
                     fmt::arg("style", kReportStyle), fmt::arg("body", body),
                     fmt::arg("script", kReportScript));
}

}  // namespace itn
