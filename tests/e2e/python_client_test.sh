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

/usr/bin/python3 "$ITN_SOURCE/client/examples/itn_client.py" --worker "$worker" \
  --predictor "$address" | tee "$folder/result.json"

/usr/bin/python3 - "$folder/result.json" <<'CHECK'
import json, sys
result = json.load(open(sys.argv[1]))
derivative = result["d radiance / d albedo"]
difference = result["finite difference in albedo"]
# 64 samples on some 200 pixels know both to about 1 %, and they share their noise.
assert abs(derivative / difference - 1) < 0.05, (derivative, difference)
assert result["radiance"] > 1 and result["d radiance / d g"] != 0, result
prediction = result["prediction"]
assert prediction["sigma_t"] > 0 and 0 <= prediction["albedo"] <= 1, prediction
assert -1 < prediction["g"] < 1, prediction
CHECK
