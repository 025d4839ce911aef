// What random shapes cost: CPU time by kind, on one thread.
//
//   shapes_bench [--count N] [--seed S]
#include <fmt/format.h>
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <map>

#include "client/geometry/random_shape.h"
#include "client/geometry/sdf/random_solid.h"

namespace {

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct Cost {
  uint64_t shapes = 0, triangles = 0;
  double seconds = 0, most = 0;

  void add(double took, uint64_t size) {
    ++shapes;
    triangles += size;
    seconds += took;
    most = std::max(most, took);
  }
  void print(std::string_view name) const {
    const auto n = static_cast<double>(std::max<uint64_t>(shapes, 1));
    fmt::print("{:<10} {:>7} {:>9.1f} {:>9.1f} {:>10.0f}\n", name, shapes, 1e3 * seconds / n,
               1e3 * most, static_cast<double>(triangles) / n);
  }
};

}  // namespace

int main(int argc, char** argv) {
  uint64_t count = 300, seed = 1;
  CLI::App app("CPU time of random shapes");
  app.add_option("--count", count, "Shapes")->capture_default_str();
  app.add_option("--seed", seed, "Of the set")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  std::map<itn::sdf::Kind, Cost> by_kind;
  Cost all;
  for (uint64_t i = 0; i < count; ++i) {
    const uint64_t shape = itn::random_shape_seed(seed, i);
    const double start = cpu_seconds();
    const size_t triangles = itn::random_shape(shape).triangles.size();
    const double took = cpu_seconds() - start;
    by_kind[itn::random_shape_kind(shape)].add(took, triangles);
    all.add(took, triangles);
  }
  fmt::print("{:<10} {:>7} {:>9} {:>9} {:>10}\n", "kind", "shapes", "mean ms", "most ms",
             "triangles");
  for (const itn::sdf::KindInfo& info : itn::sdf::kKinds) by_kind[info.kind].print(info.name);
  all.print("all");
}
