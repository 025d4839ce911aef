#!/usr/bin/env bash
# docker-compose.yml is one that Compose understands; it needs no engine for that.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"

if docker compose version >/dev/null 2>&1; then
  compose=(docker compose)
elif command -v docker-compose >/dev/null; then
  compose=(docker-compose)
else
  echo "skipped: there is no docker compose (Debian: docker-compose)"
  exit 77
fi

# config FILE: what Compose makes of it, the client's profile included.
config() { "${compose[@]}" -f "$1" --project-directory "$ITN_SOURCE" --profile client config; }

config "$ITN_SOURCE/docker-compose.yml" >"$folder/config" 2>"$folder/errors" ||
  fail "$(<"$folder/errors")"
[[ ! -s $folder/errors ]] || fail "$(<"$folder/errors")"
for service in worker predictor itn; do
  grep -qx "  $service:" "$folder/config" || fail "no service $service: $(<"$folder/config")"
done

# A misspelled setting would have shown.
sed 's/read_only/readonly/' "$ITN_SOURCE/docker-compose.yml" >"$folder/wrong.yml"
if config "$folder/wrong.yml" >"$folder/config" 2>&1; then
  fail "Compose takes any setting"
fi
echo "${compose[*]}: three services"
