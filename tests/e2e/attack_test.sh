#!/usr/bin/env bash
# Whatever is sent to a worker, its memory stays below the figure that it was started with, and it
# answers afterwards.
set -euo pipefail
if ! /usr/bin/python3 -c 'import grpc'; then
  echo "skipped: needs python3-grpcio"
  exit 77
fi
/usr/bin/python3 "$ITN_SOURCE/tests/e2e/attacks.py" "$ITN_BIN/itn-worker"
