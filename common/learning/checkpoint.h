// Checkpoint files: a trained model, and what is needed to train it further. Data only: a file from
// a stranger is safe to open.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "itn/v1/learning.pb.h"

namespace itn {

// The names of the checkpoints in the folder of a run: the latest, and the one before it.
inline constexpr const char* kCheckpointName = "checkpoint.itn";
inline constexpr const char* kPreviousCheckpointName = "checkpoint.previous.itn";
// The model that was best on the validation split, without what is needed to train it further.
inline constexpr const char* kBestCheckpointName = "best.itn";

// File format, numbers little-endian:
//
//   8 characters   "ITNCKPT2"
//   uint64         size of the message, at most 256 KiB
//   uint64         size of the data
//   32 bytes       SHA-256 of message and data
//   message        a serialized itn.v1.Checkpoint whose tensors have no data
//   data           of its tensors, one after the other: the model's weights, its outlier_model's,
//                  the optimizer's, the run's own
//
// At any moment `path` is either the old file or the new one, whole. Throws Error (kIo).
void write_checkpoint(const std::filesystem::path& path, v1::Checkpoint checkpoint);

// Writes the latest checkpoint of the run in this folder and keeps the one that was the latest.
// There is a whole one under kCheckpointName at any moment. Throws Error (kIo).
void write_latest_checkpoint(const std::filesystem::path& folder, v1::Checkpoint checkpoint);

// `path`: the file, or the folder of a run. The sizes that a file states are checked against the
// size that it has before anything is allocated; whether the tensors are those of the model is
// checked by load_encoder(). Throws Error: kIo (missing, unreadable, not a regular file), kDataLoss
// (cut short, damaged; says whether the folder's previous checkpoint is whole), kInvalidInput (not
// a checkpoint, or one of an earlier version, whose weights were archives that can carry code).
v1::Checkpoint read_checkpoint(const std::filesystem::path& path);

// The latest checkpoint in the folder of a run, if there is any. Throws as read_checkpoint().
std::optional<v1::Checkpoint> find_checkpoint(const std::filesystem::path& folder);

// The digest of the weights of a model, in hexadecimal.
std::string weights_sha256(const v1::Model& model);

}  // namespace itn
