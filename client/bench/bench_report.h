// What a benchmark says: a row for each load, as a table, CSV, or JSON.
#pragma once

#include <string>

#include "client/bench/statistics.h"

namespace itn {

enum class BenchFormat { kText, kCsv, kJson };

// What was measured, at one load.
struct BenchRow {
  bool open_loop = false;
  double load = 0;            // callers, or calls per second
  double units_per_call = 0;  // what was done in a call
  BenchResult result;
};

// The first line; empty for JSON, whose rows are objects of a line each. `unit`: what is done in a
// call, e.g. "paths".
std::string bench_header(BenchFormat format, bool open_loop, const std::string& unit);

// Latencies of a row without answers are "-", empty in CSV, and null in JSON.
std::string bench_line(BenchFormat format, const BenchRow& row, const std::string& unit);

}  // namespace itn
