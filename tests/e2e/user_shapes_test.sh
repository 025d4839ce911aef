#!/usr/bin/env bash
# Dataset, training, evaluation and prediction with the user's own meshes: those of the validation
# data, where they are there.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"

meshes=${ITN_VALIDATION_DATA:-$ITN_SOURCE/../shared/data}/meshes
if [[ ! -d $meshes ]]; then
  echo "skipped: no meshes at $meshes (set ITN_VALIDATION_DATA)"
  exit 77
fi

itn dataset "$folder/dataset" --shapes "$meshes" --count 32 --resolution 32 --spp 8 2>/dev/null
itn train "$folder/dataset" -o "$folder/run" --steps 20 --batch 8 --base-channels 4 --lr 1e-3 \
  2>/dev/null
itn evaluate "$folder/run" --dataset "$folder/dataset" 2>/dev/null | tee "$folder/table"
grep -q -i "constant predictor" "$folder/table" || fail "no constant predictor in the table"
image=$(find "$folder/dataset" -name '*.exr' | sort | tail -n 1)
itn predict "$image" --model "$folder/run" --json
