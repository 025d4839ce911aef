#!/usr/bin/env bash
# Installs what is missing, builds, and runs all tests. Arguments go to ctest, e.g. -L unit or
# -R Furnace.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

deploy/bootstrap.sh
deploy/build.sh
# Two at a time at most: the tests of rendering and training use every processor themselves.
jobs=$(nproc)
ctest --preset release -j $((jobs < 2 ? jobs : 2)) "$@"
