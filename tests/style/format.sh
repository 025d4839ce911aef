#!/usr/bin/env bash
# Every source is formatted as .clang-format says. Exit code 77, skipped: no clang-format 14, the
# one of Debian 12; others break lines elsewhere.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

if ! [[ $(clang-format --version 2>/dev/null) == *"version 14."* ]]; then
  echo "skipped: needs clang-format 14"
  exit 77
fi
find common server client tests \( -name '*.cpp' -o -name '*.h' \) -print0 |
  xargs -0 clang-format --dry-run -Werror
