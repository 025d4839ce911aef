// What a run tells of its steps: for programs, for spreadsheets, and as a picture.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "client/chart.h"
#include "client/files/line_file.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// In the folder of a run: metrics.jsonl (a TrainingMetrics as JSON a line), metrics.csv (the same
// numbers in columns; empty where there is none) and curves.png.
class MetricsLog {
 public:
  // Goes on after `step` steps: lines of later ones, which will be taken again, are forgotten.
  // Throws Error (kIo).
  MetricsLog(const std::filesystem::path& folder, uint64_t step);

  // Throws Error (kIo); what could not be written is written by the next call, or by flush().
  void append(const v1::TrainingMetrics& metrics);

  // Throws Error (kIo) unless all is written that was appended.
  void flush();

  // Draws the picture anew. Throws Error (kIo).
  void draw() const;

 private:
  void remember(const v1::TrainingMetrics& metrics);

  std::filesystem::path folder_;
  std::optional<LineFile> lines_, columns_;
  std::vector<Curve> curves_;  // those that are drawn
};

// The file of a run that is for programs, and what it says, step by step; nothing if there is none.
inline constexpr const char* kMetricsName = "metrics.jsonl";
std::vector<v1::TrainingMetrics> read_metrics(const std::filesystem::path& file);

}  // namespace itn
