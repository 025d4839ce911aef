// Whole files in memory, of a bounded size.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace itn {

// What a protobuf message, and so a scene, a manifest or a checkpoint, can take.
inline constexpr uint64_t kMaxMessageFileBytes = (uint64_t{1} << 31) - 1;

// The content of a regular file (or a link to one). `what` is its name in messages, e.g. "scene".
// A FIFO, a device or a folder is refused without waiting for it. Throws Error: kIo (missing,
// unreadable, not a regular file), kInvalidInput (more than `max_bytes`, whatever size it claims).
std::string read_file(const std::filesystem::path& path, const std::string& what,
                      uint64_t max_bytes = kMaxMessageFileBytes);

// The content of such a file, or of standard input to its end where the path is "-".
std::string read_file_or_stdin(const std::filesystem::path& path, const std::string& what,
                               uint64_t max_bytes = kMaxMessageFileBytes);

}  // namespace itn
