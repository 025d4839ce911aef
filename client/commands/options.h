// Flags that several commands share.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"

namespace itn {

// What a worker takes at most, unless it is told to take less.
inline const CLI::Validator kSppRange = number_in(1U, 1U << 20);
inline const CLI::Validator kAnySeed = number_in(uint64_t{0}, UINT64_MAX);

// Of names and versions of models, which go to terminals and logs.
constexpr size_t kMaxModelName = 100;
inline bool fits_model_name(char c) {
  return c >= ' ' && c <= '~';
}
inline const CLI::Validator kModelName(
    [](const std::string& text) {
      const bool fits = text.size() <= kMaxModelName && std::ranges::all_of(text, fits_model_name);
      return fits ? std::string() : "must be at most 100 printable ASCII characters";
    },
    "", "");

// What of a folder's name can be a model's.
inline std::string as_model_name(std::string text) {
  text.resize(std::min(text.size(), kMaxModelName));
  std::ranges::replace_if(
      text, [](char c) { return !fits_model_name(c); }, '_');
  return text;
}

// Nobody's photograph or mask is replaced by a result because of a slip of the keyboard. Throws
// Error (kUsage) if `output` is one of the inputs, under whatever name.
inline void require_no_input(const std::string& flag, const std::string& output,
                             const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code absent;
    if (is_stdout(output) || !std::filesystem::equivalent(output, input, absent)) continue;
    throw Error(ErrorKind::kUsage,
                fmt::format("{} {}: that is the input {}; name another file", flag, output, input));
  }
}

struct WorkerFlags {
  std::vector<std::string> workers;
  int threads = 0;
  uint64_t cache_mb = RenderPoolOptions{}.embedded_cache_bytes >> 20;

  RenderPoolOptions pool_options() const {
    RenderPoolOptions options;
    options.workers = workers;
    options.embedded_threads = threads;
    options.embedded_cache_bytes = cache_mb << 20;
    return options;
  }
};

// --workers, --threads and --cache-mb.
inline void add_worker_flags(CLI::App& app, WorkerFlags& flags) {
  app.add_option("--workers", flags.workers,
                 "Render workers, separated by commas: HOST:PORT each, dns:///NAME:PORT for all "
                 "addresses of a name, or file:PATH for a file of HOST:PORT lines; names and files "
                 "are looked at again during the run. None: render in this process")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--threads", flags.threads,
                 "Threads to render with in this process; 0: one per processor")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  app.add_option("--cache-mb", flags.cache_mb,
                 "Memory for scenes that are rendered in this process, in MiB. A training with "
                 "rendered image terms is faster if all its shapes fit: about 2 MiB each")
      ->check(number_in(0, 1 << 20))
      ->capture_default_str();
}

}  // namespace itn
