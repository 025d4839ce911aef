// Progress of a long job on stderr, with rate and time left.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>

namespace itn {

// "rendering 120/400 images  30% 4.1 images/s  1:08 left  loss 0.02". On a terminal one line that
// is redrawn at most ten times a second; elsewhere a plain line every ten seconds. One thread
// updates.
class Progress {
 public:
  // `total` items of the kind `unit`, of which `done` were done before (by a run that is resumed):
  // they count as done but not in the rate.
  Progress(std::string label, std::string unit, uint64_t total, uint64_t done = 0,
           std::FILE* out = stderr);
  // Ends the line that was begun; says nothing of success.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `note` is shown at the end of the line, e.g. the current loss.
  void update(uint64_t done, const std::string& note = "");
  // It ends `seconds` from now at the latest, where a limit of time is left of that many.
  void end_within(double seconds);
  // The last line, with the time that everything took. Later calls do nothing.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;

  std::string line(Clock::time_point now) const;
  void show(Clock::time_point now);

  std::string label_, unit_, note_;
  uint64_t total_, first_, done_;
  std::FILE* out_;
  bool terminal_;
  bool line_begun_ = false;
  bool finished_ = false;
  Clock::time_point start_ = Clock::now();
  Clock::time_point shown_ = start_;
  std::optional<Clock::time_point> end_;  // at the latest
};

// Nothing more is shown, by any Progress of the program.
void silence_progress();

// "59 s", "1:08", "2:03:59".
std::string format_duration(std::chrono::seconds duration);

}  // namespace itn
