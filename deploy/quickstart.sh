#!/usr/bin/env bash
# The main job of itn, from nothing: installs what is missing, builds, renders, refines, predicts with a
# model that comes with it; then renders a small dataset, trains an RN and an ITN, and compares them on
# unseen shapes and lights with the constant predictor. What is done already is not done again.
#
#   deploy/quickstart.sh [FOLDER]      default: out/quickstart
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

out=${1:-out/quickstart}
bin=build/release/bin
dataset=$out/dataset
mkdir -p "$out"

steps=$(grep -c '^step "' deploy/quickstart.sh)
step() { printf '\n== %d of %d, after %d:%02d: %s\n' $((++done_)) $steps $((SECONDS / 60)) $((SECONDS % 60)) "$*"; }
done_=0
say() { printf '%s\n' "$@" | fold -s -w 100; }

step "Install what is missing"
deploy/bootstrap.sh

step "Build (messages are in $out/build.log)"
deploy/build.sh itn 2>&1 | tee "$out/build.log" |
  while IFS= read -r line; do
    if [[ $line == \[* ]]; then printf '\r%-20.20s' "${line%%]*}]"; fi
  done || { tail -n 30 "$out/build.log"; exit 1; }
echo

step "Render a cube of sigma_t 60, albedo 0.8, g 0.3, with derivatives"
"$bin/itn" render client/examples/cube.textproto -o "$out/cube.exr" --picture "$out/cube.png" \
  --sigma-t 60 --albedo 0.8 --g 0.3 --spp 256 --derivatives sigma_t,albedo,g

step "Find that material from the image, where shape, light and camera are known: to a per cent"
"$bin/itn" refine "$out/cube.exr" --scene client/examples/cube.textproto --init mean -o "$out/refined" \
  --time-limit 60

step "Read it off the image alone: coarse, with intervals that say how coarse"
"$bin/itn" predict "$out/cube.exr" --object-size 1

step "From a picture of a mug, 95 mm high, to a material for MaterialX, and a page about it"
"$bin/itn" predict client/examples/mug.jpg --mask client/examples/mug_mask.png --object-size 95 \
  --report "$out/mug.html" --scene client/examples/mug.textproto
"$bin/itn" predict client/examples/mug.jpg --mask client/examples/mug_mask.png --object-size 95 \
  --format openpbr -o "$out/mug.mtlx"
say "The picture is a render of ours. Look at $out/mug.html: the picture stands beside a render of the answer."

step "Render a dataset: 1600 images of 64 x 64 pixels; shapes and lights of the test are apart"
"$bin/itn" dataset "$dataset" --random-shapes 400 --count 1600 --resolution 64 --noise 6% --rotate \
  --validation-fraction 0.17

step "Train a regressor network (RN) that answers distributions"
"$bin/itn" train "$dataset" -o "$out/rn" --preset residual --base-channels 16 --add-noise 12% \
  --batch 16 --steps 2500 --resume

step "Train an inverse transport network (ITN) from there, with renders in the loss"
"$bin/itn" train "$dataset" -o "$out/itn" --preset residual --loss itn --init "$out/rn" \
  --base-channels 16 --add-noise 12% --batch 8 --steps 25 --learning-rate 1e-4 --spp 64 --resume

step "Errors on shapes and lights that neither has seen"
"$bin/itn" evaluate "$out/itn" "$out/rn" --dataset "$dataset" --rerender 10 \
  --spp 128 --picture "$out/comparison.png" --examples 5
say "" \
  "A network of a minute's training is better than the best constant in all three parameters, and its" \
  "intervals hold what they promise: that is what to look for. RN and ITN are equal here;" \
  "docs/rerendering-loss.md says why. docs/training.md says what makes networks better." \
  "Input, re-rendering with the prediction, and difference: $out/comparison.png"
