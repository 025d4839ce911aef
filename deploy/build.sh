#!/usr/bin/env bash
# Builds itn, optimised, into build/release. Arguments are targets; default: everything.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! cmake --preset release >"$log" 2>&1; then
  cat "$log" >&2
  exit 1
fi

# A compiler of these sources takes up to 2 GiB.
processors=$(nproc)
memory=$(awk '/MemAvailable/ {print int($2 / 2097152) + 1}' /proc/meminfo)
jobs=$((memory < processors ? memory : processors))

cmake --build --preset release -j "$jobs" ${1:+--target "$@"}
