#!/usr/bin/env bash
# Measures the tracer against its reference, and how its cost grows: runs in turn, medians, ratios.
#
#   tests/bench/run.sh [--json] [--each] [--quick]
#
#   --json   for machines, instead of tables
#   --each   also what every technique is worth (takes three times as long)
#   --quick  fewer samples, for a first look: some four minutes instead of fifteen
#
# Meshes of $ITN_VALIDATION_DATA/meshes (bunny, armadillo, dragon_40k) are measured too if they are
# there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

format=table
spp=64
each=
repetitions=3
for argument in "$@"; do
  case $argument in
    --json) format=json ;;
    --each) each=--each ;;
    --quick) spp=8 && repetitions=2 ;;
    *) sed -n '2,11p' "$0" >&2 && exit 2 ;;
  esac
done

deploy/bootstrap.sh >&2
deploy/build.sh tracer_bench >&2
result=$(mktemp)
trap 'rm -f "$result"' EXIT
bench=build/release/bin/tracer_bench
for part in "compare --spp $spp $each" paper scaling dataset; do
  # shellcheck disable=SC2086
  $bench --repetitions $repetitions $part >>"$result"
done
python3 tests/bench/summarise.py "$format" "$result"
