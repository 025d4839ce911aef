#!/usr/bin/env bash
# What it costs that renders come from several processes: the time of one dataset with two workers of
# one thread each against one worker of two threads, in turn, and the ratio of the medians.
#
#   tests/bench/workers_bench.sh [ROUNDS]      5 by default; builds nothing
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
ITN_BIN=$PWD/build/release/bin ITN_SOURCE=$PWD
source tests/e2e/support.sh
rounds=${1:-5}

start one itn-worker --threads 2
one=$address
start first itn-worker --threads 1
two=$address
start second itn-worker --threads 1
two+=,$address

# seconds WORKERS: of the dataset.
seconds() {
  local begin
  begin=$(date +%s.%N)
  rm -rf "$folder/dataset"
  itn dataset "$folder/dataset" --count 64 --resolution 64 --spp 256 --seed 3 --workers "$1" \
    2>"$folder/log" || fail "$(tail -n 3 "$folder/log")"
  awk "BEGIN { print $(date +%s.%N) - $begin }"
}
median() { sort -n | awk '{ v[NR] = $1 } END { print (v[int((NR + 1) / 2)] + v[int(NR / 2) + 1]) / 2 }'; }

seconds "$one" >/dev/null # both hold the scenes from here on
seconds "$two" >/dev/null
for ((i = 0; i < rounds; ++i)); do
  seconds "$one" >>"$folder/one"
  seconds "$two" >>"$folder/two"
done
one=$(median <"$folder/one") two=$(median <"$folder/two")
echo "one worker of two threads: $one s; two of one: $two s;" \
  "$(awk "BEGIN { printf \"%.1f\", 100 * $one / $two }") % of its speed (medians of $rounds)"
