// Flags that several commands share.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "client/rpc/client_security.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/printable.h"
#include "common/render_limits.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// What a worker takes at most, unless it is told to take less.
inline const CLI::Validator kSppRange = number_in(1U, kMaxSamples);
inline const CLI::Validator kAnySeed = number_in(uint64_t{0}, UINT64_MAX);

// 5% as 0.05.
inline const CLI::Validator kPercentToPart(
    [](std::string& text) {
      double percent = 0;
      const char* const end = text.data() + text.size();
      const auto [unit, error] = std::from_chars(text.data(), end, percent);
      if (error == std::errc() && unit + 1 == end && *unit == '%') {
        text = fmt::format("{}", percent / 100);
      }
      return std::string();
    },
    "", "");

// NAME=NUMBER, as `example`, of a flag.
inline std::pair<std::string, double> named_number(const std::string& flag, const std::string& text,
                                                   const std::string& example) {
  const size_t equals = text.find('=');
  double value = 0;
  const char* const end = text.data() + text.size();
  const char* const begin = equals == std::string::npos ? end : text.data() + equals + 1;
  const auto [rest, error] = std::from_chars(begin, end, value);
  if (error != std::errc() || rest != end || !std::isfinite(value)) {
    throw Error(ErrorKind::kUsage,
                fmt::format("{} {}: it is NAME=NUMBER, as {}", flag, printable(text), example));
  }
  return {text.substr(0, equals), value};
}

// Takes one address where other flags take lists.
inline const CLI::Validator kOneServer(
    [](const std::string& text) {
      const bool one = text.find(',') == std::string::npos;
      return one ? std::string() : fmt::format("takes one HOST:PORT, not several: {}", text);
    },
    "", "");

// The most characters of names and versions of models, which go to terminals and logs.
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

// For load_scene().
inline void add_mesh_unit_flag(CLI::App& app, std::optional<v1::LengthUnit>& unit) {
  const std::map<std::string, v1::LengthUnit> units{
      {"mm", v1::MM}, {"cm", v1::CM}, {"m", v1::M}, {"inch", v1::INCH}};
  app.add_option_function<std::string>(
         "--mesh-unit", [&unit, units](const std::string& name) { unit = units.at(name); },
         "Unit of length of the mesh files. Default: what the scene says of each, or mm")
      ->check(one_of({"mm", "cm", "m", "inch"}));
}

// For files of photographs.
inline void add_encoding_flag(CLI::App& app, std::optional<bool>& is_linear) {
  app.add_option_function<std::string>(
         "--encoding",
         [&is_linear](const std::string& name) {
           if (name != "file") is_linear = name == "linear";
         },
         "What the numbers of PNG, JPEG, TIFF, HEIC and WebP stand for: linear light, sRGB, or "
         "what the file says. Default: file; integers that say nothing are sRGB")
      ->check(one_of({"file", "linear", "srgb"}));
}
inline void add_layer_flag(CLI::App& app, std::string& layer) {
  app.add_option("--layer", layer,
                 "Of an OpenEXR file, the layer that is meant, such as ViewLayer.DiffDir. Default: "
                 "R, G and B, Y, or those of the only layer that has them, or of Blender's "
                 "Combined");
}

// For files of renderers.
inline void add_scene_unit_flag(CLI::App& app, double& mm_per_scene_unit) {
  app.add_option_function<std::string>(
         "--scene-unit",
         [&mm_per_scene_unit](const std::string& unit) {
           mm_per_scene_unit = unit == "m" ? 1000 : unit == "cm" ? 10 : 1;
         },
         "Unit of length of the renderer's scene")
      ->check(CLI::IsMember({"mm", "cm", "m"}))
      ->default_str("mm");
}

// How connections to workers and predictors are secured; defaults are in the environment.
inline void add_security_flags(CLI::App& app, ClientSecurity& security) {
  CLI::Option* const authority =
      app.add_option("--tls-ca", security.files.authority,
                     "PEM file of the certificate of the authority that the servers' certificates "
                     "come from: connections are by TLS");
  CLI::Option* const certificate =
      app.add_option("--tls-cert", security.files.certificate,
                     "PEM file of a certificate to show to servers that ask for one (mutual TLS)");
  CLI::Option* const key =
      app.add_option("--tls-key", security.files.key, "PEM file of that certificate's private key");
  certificate->needs(key);
  key->needs(certificate);
  CLI::Option* const name =
      app.add_option("--tls-server-name", security.server_name,
                     "What the servers' certificates call them, if not as their addresses do");
  CLI::Option* const token = app.add_option(
      "--token-file", security.token_file,
      "File with the secret that servers want of calls; without --tls-ca, it does not leave this "
      "machine");
  authority->envname("ITN_TLS_CA");
  certificate->envname("ITN_TLS_CERT");
  key->envname("ITN_TLS_KEY");
  name->envname("ITN_TLS_SERVER_NAME");
  token->envname("ITN_TOKEN_FILE");
}

// --format and, for short, --json. `message`: what JSON is of.
inline void add_format_flags(CLI::App& app, bool& json, const std::string& message) {
  app.add_option_function<std::string>(
         "--format", [&json](const std::string& format) { json = format == "json"; },
         "Print the result as text or as JSON (" + message + ")")
      ->check(one_of({"text", "json"}))
      ->default_str("text");
  app.add_flag("--json", json, "--format json");
}

struct WorkerFlags {
  std::vector<std::string> workers;
  ClientSecurity security;
  int threads = 0;
  uint64_t cache_mb = RenderPoolOptions{}.embedded_cache_bytes >> 20;

  RenderPoolOptions pool_options() const {
    RenderPoolOptions options;
    options.workers = workers;
    options.security = security;
    options.embedded_threads = threads;
    options.embedded_cache_bytes = cache_mb << 20;
    return options;
  }
};

// --workers, how to connect to them, --threads and --cache-mb.
inline void add_worker_flags(CLI::App& app, WorkerFlags& flags) {
  app.add_option(
         "--workers", flags.workers,
         "Render workers, separated by commas: HOST:PORT or unix:PATH each, dns:///NAME:PORT "
         "for all addresses of a name, or file:PATH for a file of HOST:PORT lines; names and files "
         "are looked at again during the run. None: render in this process")
      ->delimiter(',')
      ->allow_extra_args(false);
  add_security_flags(app, flags.security);
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
