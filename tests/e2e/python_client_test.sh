#!/usr/bin/env bash
# A program in another language that has only the .proto files renders, differentiates and predicts.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"

if ! /usr/bin/python3 -c 'import grpc, numpy, google.protobuf' || ! command -v grpc_python_plugin; then
  echo "skipped: needs python3-grpcio, python3-protobuf, python3-numpy, protobuf-compiler-grpc"
  exit 77
fi

start worker itn-worker
worker=$address
itn dataset "$folder/dataset" --count 16 --resolution 16 --spp 4 2>/dev/null
itn train "$folder/dataset" -o "$folder/run" --steps 2 --batch 4 --base-channels 4 2>/dev/null
start predictor itn-predictor --model "$folder/run"

client() { /usr/bin/python3 "$ITN_SOURCE/client/examples/itn_client.py" "$@"; }

client --worker "$worker" --predictor "$address" | tee "$folder/result.json"

/usr/bin/python3 - "$folder/result.json" <<'CHECK'
import json, sys
result = json.load(open(sys.argv[1]))
for name in ("albedo", "surface[0].reflectance"):
    row = result[f"d radiance / d {name}"]
    derivative, difference = row["derivative"], row["finite difference"]
    assert row["agrees"], (name, row)
    # Known well enough for agreement to mean something.
    assert 0 < derivative["standard error"] < 0.1 * derivative["mean"], (name, row)
    assert abs(derivative["mean"] / difference["mean"] - 1) < 0.05, (name, row)
assert result["gradient is that of the images"]["agrees"], result
radiance = result["radiance"]
assert radiance["mean"] > 1 and 0 < radiance["standard error"] < 0.1 * radiance["mean"], radiance
assert result["d radiance / d g"]["derivative"]["mean"] != 0, result
prediction = result["prediction"]
assert prediction["sigma_t"] > 0 and 0 <= prediction["albedo"] <= 1, prediction
assert -1 < prediction["g"] < 1, prediction
CHECK

# fails CODE TEXT FLAGS...: one line that has the text, the exit code, no traceback.
fails() {
  local code=$1 text=$2 result=0
  shift 2
  client "$@" >/dev/null 2>"$folder/errors" || result=$?
  [[ $result == "$code" ]] || fail "exit code $result rather than $code: $(<"$folder/errors")"
  [[ $(wc -l <"$folder/errors") == 1 ]] || fail "not one line: $(<"$folder/errors")"
  grep -qF -- "$text" "$folder/errors" || fail "no \"$text\" in: $(<"$folder/errors")"
}
fails 5 "worker 127.0.0.1:1: " --worker 127.0.0.1:1
fails 5 "$address is not a worker; itn-worker is one" --worker "$address"
fails 5 "$worker is not a predictor; itn-predictor is one" --worker "$worker" --predictor "$worker"
fails 4 "there is no itn/v1/scene.proto in it" --proto "$folder"

# The load that tests/bench puts on servers, in Python, too.
/usr/bin/python3 "$ITN_SOURCE/tests/bench/load.py" "$worker" --seconds 0.2 --size 8 --spp 1 \
  --concurrency 1,3 | tee "$folder/load"
/usr/bin/python3 "$ITN_SOURCE/tests/bench/load.py" "$address" --predict --seconds 0.2 --rate 20 |
  tee -a "$folder/load"
# Two headers and three loads, at each of which calls were answered and none failed.
[[ $(grep -cE '^(callers|rate) .* [1-9][0-9.]+ .* 0$' "$folder/load") == 3 ]] || fail "load.py"
