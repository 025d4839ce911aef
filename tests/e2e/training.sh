# A training with renders in its loss that something happens to, compared with one that nothing happens to:
# the same weights and the same metrics of every step, bit for bit, so that nothing was lost and
# nothing counted twice. Sourced after support.sh; the flags are then in $training, the undisturbed
# result in $folder/expected.

# Far beyond what a recovery takes on a machine of its own: this one may be busy.
most_seconds=60
steps=24

# The weights, and the metrics of each step but for their times.
result() {
  sha256sum <"$folder/$1/checkpoint.itn"
  sed -E 's/"seconds":[^,}]*//' "$folder/$1/metrics.jsonl"
}
seconds_of() { sed -E 's/.*"seconds":([^,}]*).*/\1/' "$folder/$1/metrics.jsonl"; }
steps_of() {
  [[ -e $folder/$1/metrics.jsonl ]] || { echo 0 && return; }
  wc -l <"$folder/$1/metrics.jsonl"
}
has_steps() { (($(steps_of "$1") >= $2)); }

# begin_training NAME COMMAND...: `itn train` by itself or within another program, up to its third step;
# it goes on in the background.
begin_training() {
  name=$1
  shift
  "${@:1:$#-2}" itn train "${training[@]}" -o "$folder/$name" "${@:$#-1}" 2>"$folder/log" >/dev/null &
  run=$!
  servers+=("$run")
  until_true "three steps" has_steps "$name" 3
}

# finish WHAT: the training ends as if nothing had happened. Prints how much longer than the usual step
# the longest one took since: that is how long the recovery took, or what the machine is like.
finish() {
  local code=0 seconds
  wait "$run" || code=$?
  run=
  ((code == 0)) || fail "$1: the training ended with $code: $(tail -n 3 "$folder/log")"
  result "$name" >"$folder/result"
  diff "$folder/expected" "$folder/result" >/dev/null || fail "$1: other weights or metrics"
  mapfile -t seconds < <(seconds_of "$name" | tail -n +4 | sort -g)
  awk -v what="$1" -v usual="${seconds[${#seconds[@]} / 2]}" -v longest="${seconds[-1]}" \
    -v most="$most_seconds" 'BEGIN {
      printf "%-48s usual step %4.2f s, recovery %5.2f s\n", what, usual, longest - usual
      exit longest > most
    }' || fail "$1: a step took longer than $most_seconds s"
}

itn dataset "$folder/dataset" --count 16 --resolution 16 --spp 4 &>/dev/null
training=("$folder/dataset" --loss itn --batch 8 --base-channels 4 --lr 1e-3 --seed 3
  --torch-threads 1 --model-name model)
# Steps of about a quarter of a second.
itn train "${training[@]}" -o "$folder/trial" --spp 256 --steps 4 --threads 2 &>/dev/null
training+=(--steps "$steps" --spp "$(seconds_of trial | tail -n 3 |
  awk '{ sum += $1 } END { print int(256 * 0.25 * 3 / sum) }')")
itn train "${training[@]}" -o "$folder/undisturbed" --threads 2 &>/dev/null
result undisturbed >"$folder/expected"
