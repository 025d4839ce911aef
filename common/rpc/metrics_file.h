// A server's status as a file for Prometheus: node_exporter's textfile collector reads it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

#include "itn/v1/status.pb.h"

namespace itn {

// In Prometheus' text format 0.0.4: times in seconds, memory in bytes, counters since the start.
// Every sample has the label server="`server`", by which those of several servers of a machine
// differ.
std::string exposition(const v1::ServerStatus& status, const std::string& server);

// Throws Error (kIo) if a MetricsFile of this path would: it cannot be written, or is no file that
// can be replaced.
void check_metrics_file(const std::filesystem::path& path);

// Written at once, then again and again, and a last time at the end; whole at any time.
class MetricsFile {
 public:
  // `server`: as exposition(). Throws Error as check_metrics_file(); later, that is logged, once
  // until it can be written again.
  MetricsFile(std::filesystem::path path, std::string server,
              std::chrono::duration<double> interval, std::function<v1::ServerStatus()> status);
  ~MetricsFile();

 private:
  void write() const;
  void keep_writing(const std::stop_token& stop);

  const std::filesystem::path path_;
  const std::string server_;
  const std::chrono::duration<double> interval_;
  const std::function<v1::ServerStatus()> status_;
  bool failed_ = false;
  std::mutex mutex_;
  std::condition_variable_any never_;
  std::jthread writer_;  // last: it uses what is above
};

}  // namespace itn
