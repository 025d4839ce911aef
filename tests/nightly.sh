#!/usr/bin/env bash
# What takes too long for every change: the tests with the label nightly, more fuzzing, a build of the
# benchmarks, and one of each file by itself, which finds missing includes. Arguments go to ctest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

deploy/bootstrap.sh
deploy/build.sh
deploy/build.sh tests/bench/all make_corpus
ctest --preset release -L nightly "$@"
for target in build/release/bin/fuzz_*; do
  name=${target##*/fuzz_}
  # Others than the unit tests have.
  "$target" "tests/fuzz/corpus/$name" 20000 2000 10000
done
# Other random scenes every day, for an hour.
build/release/bin/tracer_differential --first "$(date +%s)" --seconds 3600
cmake --preset by-file
cmake --build --preset by-file
