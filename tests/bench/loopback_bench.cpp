// What it costs that a worker is another process on this machine: the time of renders by one
// against that of the same renders inside this process, in turn, and the ratio of the medians. Both
// have as many threads, and at any time one of them works. Processor time, of both processes, tells
// what it costs on a machine that does other things, too.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <future>
#include <string>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "common/scene/scene_file.h"
#include "tests/support/cpu_time.h"
#include "tests/support/process.h"

namespace itn {
namespace {

struct Flags {
  std::string scene = "client/examples/cube.textproto";
  std::vector<uint32_t> spp{16};
  int threads = 0;
  int at_once = 1;
  int rounds = 100;
};

RenderJob job_of(const Flags& flags, uint32_t spp) {
  RenderJob job;
  job.scene = serialize(load_scene(flags.scene));
  job.request.mutable_material()->set_sigma_t(100);
  job.request.mutable_material()->set_albedo(0.8);
  job.request.mutable_material()->set_g(0.2);
  job.request.set_spp(spp);
  for (const v1::Parameter parameter : {v1::SIGMA_T, v1::ALBEDO, v1::G}) {
    job.request.add_derivatives(parameter);
  }
  return job;
}

// Milliseconds for each of so many renders that are asked for together.
struct Cost {
  double time = 0, cpu = 0;
};

Cost cost(RenderPool& pool, const testing::Process& worker, RenderJob job, int at_once) {
  const auto cpu_seconds = [&] { return testing::own_cpu_seconds() + worker.cpu_seconds(); };
  const double cpu = cpu_seconds();
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::future<v1::RenderGradReply>> replies;
  for (int i = 0; i < at_once; ++i) {
    job.request.set_seed(static_cast<uint64_t>(i));
    replies.push_back(pool.submit(job));
  }
  for (auto& reply : replies) reply.get();
  const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
  return {time.count() / at_once, 1e3 * (cpu_seconds() - cpu) / at_once};
}

double median(const std::vector<Cost>& costs, double Cost::*which) {
  std::vector<double> values;
  for (const Cost& cost : costs) values.push_back(cost.*which);
  std::ranges::sort(values);
  const size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

void print(const char* what, const std::vector<Cost>& here, const std::vector<Cost>& there,
           double Cost::*which) {
  const double in_process = median(here, which), by_worker = median(there, which);
  fmt::print("  {}: {:.2f} ms in this process, {:.2f} ms by a worker, {:+.2f} %\n", what,
             in_process, by_worker, 100 * (by_worker / in_process - 1));
}

int run(int argc, char** argv) {
  Flags flags;
  CLI::App app("Renders by a worker on this machine against renders in this process");
  app.add_option("--scene", flags.scene, "Scene file")->capture_default_str();
  app.add_option("--spp", flags.spp, "Samples per pixel; several are measured one after the other")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--threads", flags.threads, "Of either; 0: one per processor")
      ->capture_default_str();
  app.add_option("--at-once", flags.at_once, "Renders that are asked for together")
      ->capture_default_str();
  app.add_option("--rounds", flags.rounds, "In each of which either renders once")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const auto worker = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "itn-worker";
  const testing::Process process({worker, "--listen", "127.0.0.1:0", "--threads",
                                  std::to_string(flags.threads), "--log-level", "warning"});
  RenderPoolOptions there_options, here_options;
  there_options.workers = {process.read_line()};
  here_options.embedded_threads = flags.threads;
  RenderPool loopback(there_options), embedded(here_options);
  for (const uint32_t spp : flags.spp) {
    const RenderJob job = job_of(flags, spp);
    const auto render = [&](RenderPool& pool) { return cost(pool, process, job, flags.at_once); };
    render(embedded);  // both hold the scene from here on
    render(loopback);
    std::vector<Cost> here, there;
    for (int i = 0; i < flags.rounds; ++i) {
      if (i % 2 == 0) here.push_back(render(embedded));
      there.push_back(render(loopback));
      if (i % 2 == 1) here.push_back(render(embedded));
    }
    fmt::print("{} samples per pixel, medians of {}:\n", spp, flags.rounds);
    print("time", here, there, &Cost::time);
    print("processor time", here, there, &Cost::cpu);
  }
  return 0;
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  return itn::run(argc, argv);
}
