#include "common/rpc/request_id.h"

#include <fmt/format.h>
#include <grpcpp/client_context.h>
#include <grpcpp/server_context.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstdint>
#include <random>
#include <string_view>

#include "common/random.h"

namespace itn {
namespace {

constexpr const char* kKey = "x-request-id";

// Different in every process.
uint64_t seed() {
  std::random_device device;
  return uint64_t{device()} << 32 | device();
}

}  // namespace

std::string assign_request_id(grpc::ClientContext& context) {
  static const uint64_t process = seed();
  static std::atomic<uint64_t> calls = 0;
  std::string name = fmt::format("{:016x}", derive_seed(process, {calls++}));
  context.AddMetadata(kKey, name);
  return name;
}

grpc::Status with_request_id(const grpc::Status& status, const std::string& name) {
  if (status.ok()) return status;
  return {status.error_code(), fmt::format("{} (request {})", status.error_message(), name),
          status.error_details()};
}

std::string request_id_of(const grpc::CallbackServerContext& context) {
  const auto& metadata = context.client_metadata();
  const auto name = metadata.find(kKey);
  if (name == metadata.end()) return "-";
  const std::string_view text(name->second.data(), name->second.size());
  const auto fits = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.' || c == '_' || c == '-';
  };
  const bool is_name = !text.empty() && text.size() <= 64 && std::ranges::all_of(text, fits);
  return is_name ? std::string(text) : "?";
}

}  // namespace itn
