#!/usr/bin/env bash
# Installs what is missing, builds, and runs all tests but those that take long (tests/nightly.sh).
# Arguments go to ctest, e.g. -L unit or -R Furnace.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

deploy/bootstrap.sh
deploy/build.sh
# Two at a time at most: the tests of rendering and training use every processor themselves.
jobs=$(nproc)
log=$(mktemp)
trap 'rm -f "$log"' EXIT
code=0
ctest --preset release -j $((jobs < 2 ? jobs : 2)) -LE nightly "$@" | tee "$log" || code=$?
echo "The thirty slowest, in seconds:"
sed -nE 's/.* Test +#[0-9]+: ([^ ]+).* ([0-9.]+) sec$/\2 \1/p' "$log" | sort -rn | sed -n 1,30p
grep "tests passed" "$log" || true
exit "$code"
