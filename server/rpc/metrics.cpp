#include "server/rpc/metrics.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <utility>

#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

constexpr double kFirstBound = 1e-4;  // of a histogram, in seconds

// One family of samples after the other, as the format wants it.
class PrometheusText {
 public:
  explicit PrometheusText(std::string labels) : labels_(std::move(labels)) {}

  void family(const char* name, const char* type, const char* help) {
    family_ = name;
    text_ += fmt::format("# HELP {0} {2}\n# TYPE {0} {1}\n", name, type, help);
  }
  // `labels`: NAME="VALUE", ...
  void sample(const std::string& labels, double value, const char* suffix = "") {
    text_ += fmt::format("{}{}{{{}{}{}}} {}\n", family_, suffix, labels_, labels.empty() ? "" : ",",
                         labels, value);
  }
  void sample(const std::string& labels, uint64_t value, const char* suffix = "") {
    sample(labels, static_cast<double>(value), suffix);
  }
  template <typename Number>
  void gauge(const char* name, const char* help, Number value) {
    family(name, "gauge", help);
    sample("", value);
  }
  void counter(const char* name, const char* help, uint64_t value) {
    family(name, "counter", help);
    sample("", value);
  }

  const std::string& text() const { return text_; }

 private:
  const std::string labels_;  // of every sample
  std::string text_;
  std::string family_;
};

std::string label(const char* name, const std::string& value) {
  return fmt::format("{}=\"{}\"", name, value);
}

void add_histogram(PrometheusText& text, const std::string& method,
                   const LatencyHistogram& histogram) {
  uint64_t count = 0;
  double bound = kFirstBound;
  for (size_t i = 0; i < histogram.counts.size(); ++i) {
    count += histogram.counts[i];
    const bool last = i + 1 == histogram.counts.size();
    const std::string le = label("le", last ? "+Inf" : fmt::format("{}", bound));
    text.sample(fmt::format("{},{}", method, le), count, "_bucket");
    bound *= 2;
  }
  text.sample(method, histogram.sum, "_sum");
  text.sample(method, count, "_count");
}

}  // namespace

void LatencyHistogram::add(double seconds) {
  const double place = seconds > kFirstBound ? std::ceil(std::log2(seconds / kFirstBound)) : 0;
  ++counts[static_cast<size_t>(std::min(place, static_cast<double>(counts.size() - 1)))];
  sum += seconds;
}

void CallCounts::record(const CallRecord& call) {
  const std::lock_guard lock(mutex_);
  auto found = methods_.find(call.method);
  if (found == methods_.end()) found = methods_.emplace(call.method, Method()).first;
  Method& method = found->second;
  ++method.answers[call.status];
  method.unit = call.unit;
  if (!call.times) return;
  method.queue.add(call.times->queue);
  method.work.add(call.times->work);
  method.units += call.units;
}

CallCounts::Methods CallCounts::methods() const {
  const std::lock_guard lock(mutex_);
  return methods_;
}

std::string prometheus_text(const ServerMetrics& metrics, const std::string& server) {
  PrometheusText all(label("server", server));
  all.family("itn_info", "gauge", "What this is, as labels.");
  all.sample(label("service", metrics.service) + "," + label("version", ITN_VERSION), 1.0);
  all.gauge("itn_uptime_seconds", "Since the start.", metrics.uptime_seconds);
  all.gauge("itn_draining", "1 if it takes nothing new.", metrics.draining ? 1.0 : 0.0);
  all.gauge("itn_calls_running", "Calls that are worked on.", metrics.running);
  all.gauge("itn_calls_running_max", "Calls that can be worked on at a time.", metrics.max_running);
  all.gauge("itn_calls_waiting", "Calls that were accepted and wait.", metrics.waiting);
  all.gauge("itn_calls_waiting_max", "Calls that may wait.", metrics.max_waiting);
  all.gauge("itn_resident_memory_bytes", "Memory of the process.", metrics.resident_bytes);
  all.gauge("itn_allocated_memory_bytes", "Of the heap, allocated and not freed.",
            metrics.allocated_bytes);
  all.gauge("itn_resident_memory_max_bytes", "Its limit; 0 if there is none.",
            metrics.max_resident_bytes);
  all.gauge("itn_scene_memory_bytes", "Memory of scenes that are kept or in use.",
            metrics.scene_bytes);
  all.counter("itn_scene_hits_total", "Calls whose scene was there.", metrics.scene_hits);
  all.counter("itn_scene_misses_total", "Scenes that had to be built.", metrics.scene_misses);
  all.gauge("itn_connections", "Connections that are open.", metrics.connections);
  all.gauge("itn_connections_max", "Connections that may be open.", metrics.max_connections);
  all.family("itn_calls_total", "counter", "Calls that were answered, by their status.");
  for (const auto& [name, method] : metrics.methods) {
    for (const auto& [status, count] : method.answers) {
      all.sample(label("method", name) + "," + label("status", status_name(status)), count);
    }
  }
  all.family("itn_work_units_total", "counter", "Camera paths traced, images read.");
  for (const auto& [name, method] : metrics.methods) {
    all.sample(label("method", name) + "," + label("unit", method.unit), method.units);
  }
  all.family("itn_queue_seconds", "histogram", "How long calls that were worked on had waited.");
  for (const auto& [name, method] : metrics.methods) {
    add_histogram(all, label("method", name), method.queue);
  }
  all.family("itn_work_seconds", "histogram", "How long calls were worked on.");
  for (const auto& [name, method] : metrics.methods) {
    add_histogram(all, label("method", name), method.work);
  }
  return all.text();
}

void check_metrics_file(const std::filesystem::path& path) {
  const bool is_other = std::filesystem::exists(path) && !std::filesystem::is_regular_file(path);
  if (is_stdout(path) || is_other) {
    throw Error(ErrorKind::kIo,
                fmt::format("{} is no regular file, which metrics can replace again and again",
                            path.string()));
  }
  check_writable(path);
}

MetricsFile::MetricsFile(std::filesystem::path path, std::string server,
                         std::chrono::duration<double> interval,
                         std::function<ServerMetrics()> metrics)
    : path_(std::move(path)),
      server_(std::move(server)),
      interval_(interval),
      metrics_(std::move(metrics)) {
  check_metrics_file(path_);
  write();
  writer_ = std::jthread([this](const std::stop_token& stop) { keep_writing(stop); });
}

MetricsFile::~MetricsFile() {
  writer_ = std::jthread();
  try {
    write();
  } catch (const std::exception& error) {
    spdlog::warn("{}", error.what());
  }
}

void MetricsFile::write() const {
  write_file_atomically(path_, prometheus_text(metrics_(), server_));
}

void MetricsFile::keep_writing(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (true) {
    never_.wait_for(lock, stop, interval_, [] { return false; });
    if (stop.stop_requested()) return;
    try {
      write();
      failed_ = false;
    } catch (const std::exception& error) {
      if (!failed_) spdlog::warn("{}", error.what());
      failed_ = true;
    }
  }
}

}  // namespace itn
