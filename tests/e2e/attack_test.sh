#!/usr/bin/env bash
# Whatever is sent to a worker, its memory stays below the figure that it was started with, and it
# answers afterwards; by TLS, too, where connections are what memory and time go to.
set -euo pipefail
if ! /usr/bin/python3 -c 'import grpc'; then
  echo "skipped: needs python3-grpcio"
  exit 77
fi
attacks=$ITN_SOURCE/tests/e2e/attacks.py
/usr/bin/python3 "$attacks" "$ITN_BIN/itn-worker"
command -v openssl >/dev/null || exit 0
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$ITN_SOURCE/deploy/make-test-ca.sh" "$folder" >/dev/null
/usr/bin/python3 "$attacks" --tls "$folder" "$ITN_BIN/itn-worker" \
  unread_replies stalled_uploads rapid_reset many_connections silent_connections
