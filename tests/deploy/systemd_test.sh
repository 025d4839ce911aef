#!/usr/bin/env bash
# The units of deploy/systemd say nothing that systemd does not know, start programs that are there, and
# leave them few rights.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"

if ! command -v systemd-analyze >/dev/null; then
  echo "skipped: there is no systemd-analyze (Debian: systemd)"
  exit 77
fi

units=$folder/units
cp -r "$ITN_SOURCE/deploy/systemd" "$units"
sed -i "s|/usr/local/bin/|$ITN_BIN/|" "$units"/*.service
export SYSTEMD_UNIT_PATH=$units:  # and the system's own, after it

# Exposure is 0 to 10, here times ten: 2 is what systemd calls OK.
for unit in "$units"/*.service; do
  complaints=$(systemd-analyze verify "$unit" 2>&1) || fail "$unit: $complaints"
  [[ -z $complaints ]] || fail "$unit: $complaints"
  systemd-analyze security --offline=true --threshold=20 "$unit" >"$folder/exposure" ||
    fail "$unit: $(tail -n 1 "$folder/exposure")"
  tail -n 1 "$folder/exposure"
done

# A misspelled setting would have shown.
echo 'ProtectSytem=strict' >>"$units/itn-.service.d/common.conf"
systemd-analyze verify "$units/itn-predictor.service" 2>&1 | grep -q "ProtectSytem" ||
  fail "systemd-analyze verify does not look at common.conf"
