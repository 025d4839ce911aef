#include "common/rpc/metrics_file.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <exception>
#include <utility>

#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace {

// One family of samples after the other, as the format wants it.
class Exposition {
 public:
  explicit Exposition(std::string labels) : labels_(std::move(labels)) {}

  void family(const char* name, const char* type, const char* help) {
    family_ = name;
    text_ += fmt::format("# HELP {0} {2}\n# TYPE {0} {1}\n", name, type, help);
  }
  // `labels`: NAME="VALUE", ...
  void sample(const std::string& labels, double value, const char* suffix = "") {
    text_ += fmt::format("{}{}{{{}{}{}}} {}\n", family_, suffix, labels_, labels.empty() ? "" : ",",
                         labels, value);
  }
  void gauge(const char* name, const char* help, double value) {
    family(name, "gauge", help);
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

void add_histogram(Exposition& exposition, const std::string& method,
                   const v1::LatencyHistogram& histogram) {
  uint64_t count = 0;
  double bound = 1e-4;
  for (int i = 0; i < histogram.counts_size(); ++i) {
    count += histogram.counts(i);
    const bool last = i + 1 == histogram.counts_size();
    const std::string le = label("le", last ? "+Inf" : fmt::format("{}", bound));
    exposition.sample(fmt::format("{},{}", label("method", method), le), static_cast<double>(count),
                      "_bucket");
    bound *= 2;
  }
  exposition.sample(label("method", method), histogram.sum_seconds(), "_sum");
  exposition.sample(label("method", method), static_cast<double>(count), "_count");
}

}  // namespace

std::string exposition(const v1::ServerStatus& status, const std::string& server) {
  Exposition all(label("server", server));
  all.family("itn_info", "gauge", "What this is, as labels.");
  all.sample(label("service", status.service()) + "," + label("version", status.version()), 1);
  all.gauge("itn_uptime_seconds", "Since the start.", status.uptime_seconds());
  all.gauge("itn_draining", "1 if it takes nothing new.", status.draining() ? 1 : 0);
  all.gauge("itn_calls_running", "Calls that are worked on.",
            static_cast<double>(status.running()));
  all.gauge("itn_calls_running_max", "Calls that can be worked on at a time.",
            static_cast<double>(status.most_running()));
  all.gauge("itn_calls_waiting", "Calls that were accepted and wait.",
            static_cast<double>(status.waiting()));
  all.gauge("itn_calls_waiting_max", "Calls that may wait.",
            static_cast<double>(status.most_waiting()));
  all.gauge("itn_resident_memory_bytes", "Memory of the process.",
            static_cast<double>(status.resident_bytes()));
  all.gauge("itn_allocated_memory_bytes", "Of the heap, allocated and not freed.",
            static_cast<double>(status.allocated_bytes()));
  all.gauge("itn_resident_memory_max_bytes", "Its limit; 0 if there is none.",
            static_cast<double>(status.most_resident_bytes()));
  all.gauge("itn_scene_memory_bytes", "Memory of scenes that are kept or in use.",
            static_cast<double>(status.scene_bytes()));
  all.family("itn_scene_hits_total", "counter", "Calls whose scene was there.");
  all.sample("", static_cast<double>(status.scene_hits()));
  all.family("itn_scene_misses_total", "counter", "Scenes that had to be built.");
  all.sample("", static_cast<double>(status.scene_misses()));
  all.gauge("itn_connections", "Connections that are open.",
            static_cast<double>(status.connections()));
  all.gauge("itn_connections_max", "Connections that may be open.",
            static_cast<double>(status.most_connections()));
  all.family("itn_calls_total", "counter", "Calls that were answered, by their status.");
  for (const v1::MethodStatus& method : status.methods()) {
    for (const v1::AnswerCount& answers : method.answers()) {
      all.sample(label("method", method.method()) + "," + label("status", answers.status()),
                 static_cast<double>(answers.count()));
    }
  }
  all.family("itn_work_units_total", "counter", "Camera paths traced, images read.");
  for (const v1::MethodStatus& method : status.methods()) {
    all.sample(label("method", method.method()) + "," + label("unit", method.unit()),
               method.units());
  }
  all.family("itn_queue_seconds", "histogram", "How long calls that were worked on had waited.");
  for (const v1::MethodStatus& method : status.methods()) {
    add_histogram(all, method.method(), method.queue());
  }
  all.family("itn_work_seconds", "histogram", "How long calls were worked on.");
  for (const v1::MethodStatus& method : status.methods()) {
    add_histogram(all, method.method(), method.work());
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
                         std::function<v1::ServerStatus()> status)
    : path_(std::move(path)),
      server_(std::move(server)),
      interval_(interval),
      status_(std::move(status)) {
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
  write_file_atomically(path_, exposition(status_(), server_));
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
