#!/usr/bin/env bash
# Training with renders in the loss ends with the same weights, bit for bit, with the embedded
# worker, with one remote worker, with two, and with two of which one is killed on the way.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"

itn dataset "$folder/dataset" --count 16 --resolution 16 --spp 4 2>/dev/null

# train NAME FLAGS...: the digest of the weights is then in $weights.
train() {
  local name=$1
  shift
  itn train "$folder/dataset" -o "$folder/$name" --loss itn --steps 12 --batch 8 --spp 16 \
    --base-channels 4 --lr 1e-3 --seed 3 --torch-threads 1 --model-name model "$@" 2>"$folder/$name.log" ||
    fail "training $name: $(tail -n 3 "$folder/$name.log")"
  weights=$(sha256sum "$folder/$name"/checkpoint* | cut -d ' ' -f 1)
}

train embedded --threads 2
expected=$weights

start first itn-worker --threads 1
first=$address
train one --workers "$first"
[[ $weights == "$expected" ]] || fail "one remote worker: other weights"

start second itn-worker --threads 2
second=$address
train two --workers "$first,$second"
[[ $weights == "$expected" ]] || fail "two remote workers: other weights"

victim=$server
( # Kills the second worker when training has taken a few steps.
  for _ in {1..6000}; do
    [[ -s $folder/killed/metrics.jsonl ]] && (($(wc -l <"$folder/killed/metrics.jsonl") >= 3)) && break
    sleep 0.02
  done
  kill -9 "$victim"
) &
train killed --workers "$first,$second"
wait $! || fail "the second worker was not there to be killed"
(($(wc -l <"$folder/killed/metrics.jsonl") >= 12)) || fail "training stopped early"
[[ $weights == "$expected" ]] || fail "a worker killed on the way: other weights"
echo "the same weights four times: $expected"
