// Checkpoint files: a trained model, and what is needed to train it further.
#pragma once

#include <filesystem>

#include "itn/v1/experiment.pb.h"

namespace itn {

// The name of the checkpoint in the folder of a run; always the latest.
inline constexpr const char* kCheckpointName = "checkpoint.itn";

// File format: the 8 characters "ITNCKPT1", the size of the content as a little-endian uint64, its
// SHA-256, the content: a serialized itn.v1.Checkpoint. Written to a temporary name beside `path`
// and renamed: at any moment the file is either the old one or the new one, whole. Throws Error
// (kIo).
void write_checkpoint(const std::filesystem::path& path, const v1::Checkpoint& checkpoint);

// `path`: the file, or the folder of a run. Throws Error: kIo (missing, unreadable), kDataLoss (cut
// short, damaged), kInvalidInput (not a checkpoint).
v1::Checkpoint read_checkpoint(const std::filesystem::path& path);

}  // namespace itn
