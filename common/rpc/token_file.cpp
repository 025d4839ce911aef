#include "common/rpc/token_file.h"

#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/sha.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <sstream>
#include <utility>

#include "common/error.h"
#include "common/files/read_file.h"

namespace itn {
namespace {

constexpr size_t kMinCharacters = 16, kMaxCharacters = 4096;

std::string sha256(const std::string& text) {
  std::string digest(SHA256_DIGEST_LENGTH, '\0');
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(),
         reinterpret_cast<unsigned char*>(digest.data()));
  return digest;
}

std::string header_of(const std::string& token) {
  return "Bearer " + token;
}

// Throws Error (kInvalidInput) that does not say what the token is.
void check_token(const std::string& token, const std::string& path, int line) {
  const bool printable =
      std::ranges::all_of(token, [](unsigned char c) { return c > ' ' && c <= '~'; });
  if (printable && token.size() >= kMinCharacters && token.size() <= kMaxCharacters) return;
  throw invalid_input(
      fmt::format("the token file {}: line {} {}; \"openssl rand -hex 32\" makes a "
                  "good token",
                  path, line,
                  printable ? fmt::format("has {} characters rather than {} to {}", token.size(),
                                          kMinCharacters, kMaxCharacters)
                            : "has a space or what is not printable ASCII"));
}

std::vector<std::string> parse_tokens(const std::string& text, const std::string& path) {
  std::vector<std::string> tokens;
  std::istringstream lines(text);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.ends_with('\r')) line.pop_back();
    if (line.empty()) continue;
    check_token(line, path, number);
    tokens.push_back(std::move(line));
  }
  if (tokens.empty()) {
    throw invalid_input(fmt::format(
        "the token file {} is empty; \"openssl rand -hex 32\" makes a good token", path));
  }
  return tokens;
}

}  // namespace

TokenFile::TokenFile(std::string path) : path_(std::move(path)) {
  stamp_ = stamp_of(path_);
  read();
}

void TokenFile::read() {
  const std::vector<std::string> tokens =
      parse_tokens(read_file(path_, "token file", 1 << 20), path_);
  first_ = header_of(tokens.front());
  digests_.clear();
  for (const std::string& token : tokens) digests_.push_back(sha256(header_of(token)));
}

void TokenFile::read_if_newer() {
  const FileStamp now = stamp_of(path_);
  if (now == stamp_) return;
  stamp_ = now;
  try {
    read();
    spdlog::info("the token file {} has been read again", path_);
  } catch (const Error& error) {
    spdlog::warn("the token file has changed and cannot be used, the former tokens stay: {}",
                 error.what());
  }
}

std::string TokenFile::header() {
  const std::lock_guard lock(mutex_);
  read_if_newer();
  return first_;
}

// Digests are compared, so that neither the length of a token nor how much of it was right can be
// timed.
bool TokenFile::admits(const std::string& header) {
  const std::string digest = sha256(header);
  const std::lock_guard lock(mutex_);
  read_if_newer();
  int matches = 0;
  for (const std::string& known : digests_) {
    matches += CRYPTO_memcmp(known.data(), digest.data(), digest.size()) == 0 ? 1 : 0;
  }
  return matches > 0;
}

}  // namespace itn
