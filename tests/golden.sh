#!/usr/bin/env bash
# Digests of what itn promises to the bit: renders, a dataset, what the shipped models say of it, a
# refinement, a training and an experiment that go on. A change that is to keep bits prints the same
# before and after it.
#
#   tests/golden.sh FOLDER [BIN]      BIN: the programs, default build/release/bin
#
# The first call begins everything in FOLDER/begun, by its programs; every call goes on in a copy by
# its own: so it also shows that datasets, runs and experiments of older programs still work.
set -euo pipefail
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
bin=$(realpath "${2:-$source/build/release/bin}")
mkdir -p "$1"
cd "$1"
itn() { ITN_MODELS="$source/models" "$bin/itn" "$@"; }
# Numbers say the same under other names (bounds, too: LEAST and MOST of 0.1); times differ.
numbers() {
  sed -E 's/"[a-zA-Z_]*[sS]econds[a-zA-Z_]*": *[^,}]*//g; s/"[a-zA-Z_0-9]+" *://g; s/_LEAST"/_MIN"/g
    s/_MOST"/_MAX"/g' | tr -d ' \n'
}
# The version in a header is not promised, nor the header's digest: all count as 0.1.0's.
unversioned() {
  LC_ALL=C sed -E 's/(itn\.version\x00string\x00\x05\x00{3})...../\10.1.0/g
    s/(itn\.contents_sha256\x00string\x00.\x00{3})[0-9a-f]{64}/\1/g'
}
digest() { printf '%-28s %s\n' "$1" "$(sha256sum | cut -c1-16)"; }

training=(--batch 4 --base-channels 4 --lr 1e-3 --seed 3 --torch-threads 1 --checkpoint-every 4)
if [[ ! -e begun ]]; then
  rm -rf begun.tmp
  mkdir begun.tmp
  itn dataset begun.tmp/dataset --random-shapes 10 --count 10 --resolution 32 --rotate \
    --noise 10% -q >/dev/null
  itn train begun.tmp/dataset -o begun.tmp/rn "${training[@]}" --preset residual --steps 8 -q >/dev/null
  itn train begun.tmp/dataset -o begun.tmp/itn "${training[@]}" --loss itn --spp 8 --steps 4 -q >/dev/null
  itn render "$source/client/examples/cube.textproto" -o begun.tmp/target.exr --sigma-t 40 \
    --albedo 0.8 --g 0.3 --spp 64 -q >/dev/null
  itn refine begun.tmp/target.exr --scene "$source/client/examples/cube.textproto" --init mean \
    --max-spp 64 --max-iterations 3 -o begun.tmp/refined -q >/dev/null
  # An experiment that is killed in its middle.
  "$bin/itn" experiment --preset smoke --torch-threads 1 -o begun.tmp/experiment 2>begun.tmp/log >/dev/null &
  until grep -q "train ITN+naive" begun.tmp/log; do kill -0 $!; sleep 0.1; done
  kill -KILL $!
  wait $! 2>/dev/null || true
  mv begun.tmp begun
fi
rm -rf work
cp -r begun work

render() {
  local name=$1
  shift
  itn render "$source/client/examples/cube.textproto" -o work/image.exr -q "$@" >/dev/null
  unversioned <work/image.exr | digest "render, $name"
}
render derivatives --sigma-t 30 --albedo 0.8 --g 0.3 --spp 32 --derivatives sigma_t,albedo,g
render "pilot, object alone" --sigma-t 100 --albedo 0.95 --g 0.5 --spp 32 --pilot-spp 4 \
  --pixels object --derivatives sigma_t,albedo,g
render reference --sigma-t 30 --albedo 0.8 --g 0.3 --spp 8 --tracer reference \
  --derivatives sigma_t,albedo,g
render "scale and reflectance" --sigma-t 60 --albedo 0.5 --g -0.3 --spp 32 \
  --derivatives 'light[0].scale,surface[0].reflectance,sigma_a'

itn dataset work/dataset --count 14 -q >/dev/null
find work/dataset -name '*.exr' | sort | xargs cat | unversioned | digest "dataset, images"
for image in $(find begun/dataset -name '*.exr' | sort); do
  itn predict "$image" --object-size 1 --json -q 2>/dev/null
done | numbers | digest "predict"
itn refine begun/target.exr --scene "$source/client/examples/cube.textproto" --init mean --max-spp 64 \
  --max-iterations 6 -o work/refined -q >/dev/null
numbers <work/refined/trajectory.jsonl | digest "refine, trajectory"
numbers <work/refined/result.json | digest "refine, result"
itn train begun/dataset -o work/rn "${training[@]}" --preset residual --steps 16 --resume -q >/dev/null
digest "train, residual RN" <work/rn/checkpoint.itn
itn train begun/dataset -o work/itn "${training[@]}" --loss itn --spp 8 --steps 8 --resume -q >/dev/null
digest "train, ITN" <work/itn/checkpoint.itn
itn experiment --preset smoke --torch-threads 1 -o work/experiment -q 2>work/log >/dev/null
# But for the network that takes as many steps as there was time for.
cat work/experiment/{table_1,table_1_other_noise,gains,by_thickness,table_2}.csv |
  grep -v "time of ITN" | digest "experiment, tables"
