#!/usr/bin/env bash
# Measures the tracer and the service: runs interleaved, medians of several repetitions, ratios.
#
#   tests/bench/run.sh [--json] [REPETITIONS]      default: 7 repetitions, a table
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

format=table
if [[ ${1:-} == --json ]]; then
  format=json
  shift
fi
repetitions=${1:-7}

deploy/bootstrap.sh >&2
deploy/build.sh tracer_bench >&2
result=$(mktemp)
trap 'rm -f "$result"' EXIT
build/release/bin/tracer_bench --benchmark_enable_random_interleaving=true \
  --benchmark_repetitions="$repetitions" --benchmark_min_time=0.1 \
  --benchmark_out="$result" --benchmark_out_format=json >/dev/null
python3 tests/bench/summarise.py "$format" "$result"
