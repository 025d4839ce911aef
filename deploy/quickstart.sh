#!/usr/bin/env bash
# The main job of itn, from nothing: installs what is missing, builds, predicts with the model that
# comes with it; then renders a small dataset, trains an RN and an ITN, compares them on unseen
# shapes and lights with the constant predictor, and asks a predictor for the material in one image.
# What is done already is not done again.
#
#   deploy/quickstart.sh [FOLDER]      default: out/quickstart
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

out=${1:-out/quickstart}
bin=build/release/bin
dataset=$out/dataset
predictor=

steps=$(grep -c '^step "' deploy/quickstart.sh)
step() { printf '\n== %d of %d, after %d:%02d: %s\n' $((++done_)) $steps $((SECONDS / 60)) $((SECONDS % 60)) "$*"; }
done_=0

stop_predictor() {
  [[ -n $predictor ]] || return 0
  kill "$predictor" 2>/dev/null || true
  wait "$predictor" || true
}
trap stop_predictor EXIT

step "Install what is missing"
deploy/bootstrap.sh

step "Build what the first answer needs"
deploy/build.sh itn
mkdir -p "$out"

step "Ask a model that comes with itn: an image of sigma_t 60, albedo 0.8, g 0.3"
"$bin/itn" render client/examples/cube.textproto -o "$out/cube.exr" --sigma-t 60 --albedo 0.8 \
  --g 0.3 --spp 64
"$bin/itn" predict "$out/cube.exr" --radiance-scale 1 --object-size 1

step "From a photograph of a mug, 95 mm high, to a material for MaterialX, and a page about it"
"$bin/itn" predict client/examples/mug.jpg --mask client/examples/mug_mask.png --object-size 95 \
  --report "$out/mug.html"
"$bin/itn" predict client/examples/mug.jpg --mask client/examples/mug_mask.png --object-size 95 \
  --format openpbr -o "$out/mug.mtlx"

step "Build the servers: itn-predictor and itn-worker"
deploy/build.sh itn-predictor itn-worker

step "Render a dataset: 1600 images of 64 x 64 pixels; shapes and lights of the test are apart"
"$bin/itn" dataset "$dataset" --random-shapes 400 --count 1600 --resolution 64 --noise 6% --rotate \
  --validation-fraction 0.17

step "Train a regressor network (RN) that answers distributions"
"$bin/itn" train "$dataset" -o "$out/rn" --preset residual --base-channels 16 --add-noise 12% \
  --batch 16 --steps 2500 --resume

step "Train an inverse transport network (ITN) from there, with renders in the loss"
"$bin/itn" train "$dataset" -o "$out/itn" --preset residual --loss itn --init "$out/rn" \
  --base-channels 16 --add-noise 12% --batch 8 --steps 25 --learning-rate 1e-4 --spp 64 --resume

step "Errors on shapes and lights that neither has seen, at training's noise and at half of it"
"$bin/itn" evaluate "$out/itn" "$out/rn" --dataset "$dataset" --noise-levels --rerender 10 \
  --spp 128 --picture "$out/comparison.png"

step "Ask a predictor for the material in one of these images"
# The first image of the test, and the material it was rendered with.
read -r image sigma_t albedo g < <(awk '
  /^items/ { item = 1 }
  item { if ($1 == "split:") split_ = $2; else value[$1] = $2 }
  /^}/ && item {
    item = 0
    if (split_ == "SPLIT_TEST") {
      gsub(/"/, "", value["file:"])
      print value["file:"], value["sigma_t:"], value["albedo:"], value["g:"]
      exit
    }
  }' "$dataset/manifest.textproto")

rm -f "$out/predictor.address"
"$bin/itn-predictor" --model "$out/itn" --listen 127.0.0.1:0 --log-level warning \
  >"$out/predictor.address" &
predictor=$!
# Its one line of output is the address, once it serves.
until [[ -s $out/predictor.address ]]; do
  kill -0 "$predictor"  # or it has ended with an error
  sleep 0.1
done
"$bin/itn" predict "$dataset/$image" --predictor "$(<"$out/predictor.address")"
printf 'truth    %14.3f  %7.4f  %7.4f\n' "$sigma_t" "$albedo" "$g"

printf '\nThe mug of the photograph: %s, %s\n' "$out/mug.html" "$out/mug.mtlx"
printf 'Input, re-rendering with the prediction, and difference: %s\n' "$out/comparison.png"
