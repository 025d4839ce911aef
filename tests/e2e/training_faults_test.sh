#!/usr/bin/env bash
# What may happen to workers and clocks while a network is trained with renders in its loss: after each
# of it the weights, and the metrics of every step, are those of the undisturbed training.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"
source "$ITN_SOURCE/tests/e2e/training.sh"

# begin NAME [COMMAND...]: a training with two workers of its own, all of them run by the command.
begin() {
  start "$1-a" "${@:2}" itn-worker --threads 1
  address_a=$address worker_a=$server
  start "$1-b" "${@:2}" itn-worker --threads 1
  address_b=$address worker_b=$server
  begin_training "$@" --workers "$address_a,$address_b"
}
# restart ADDRESS: a worker there; its process is then in $server.
restart() {
  itn-worker --listen "$1" --threads 1 --log-level warning >/dev/null &
  server=$!
  servers+=("$server")
}
# ended_with PROCESS CODE WHAT: waits for it.
ended_with() {
  local code=0
  wait "$1" 2>/dev/null || code=$?
  ((code == $2)) || fail "$3 ended with $code rather than $2"
}

begin undisturbed-by-workers
finish "two workers, nothing happens"

begin killed
kill -KILL "$worker_b"
ended_with "$worker_b" 137 "a killed worker"
finish "a worker is killed"

begin frozen
kill -STOP "$worker_b"
finish "a worker is frozen (SIGSTOP)"
kill -CONT "$worker_b"

begin drained
kill -TERM "$worker_b"
ended_with "$worker_b" 0 "a worker that was told to stop"
finish "a worker is told to stop (SIGTERM)"
! grep "lost" "$folder/log" || fail "a render was lost"

begin forgetful
kill -KILL "$worker_b"
ended_with "$worker_b" 137 "a killed worker"
restart "$address_b"
renders() { (($(cpu_ticks "$server") > 20)); }
until_true "the worker that was started again renders" renders
finish "a worker is started again, its cache is empty"

begin abandoned
kill -KILL "$worker_a" "$worker_b"
ended_with "$worker_a" 137 "a killed worker"
ended_with "$worker_b" 137 "a killed worker"
until_true "the training misses its workers" grep -q . "$folder/log"
seen=$(steps_of abandoned)
restart "$address_a"
restart "$address_b"
back=$(milliseconds)
until_true "steps with workers that are back" has_steps abandoned $((seen + 1))
back=$(($(milliseconds) - back))
finish "all workers are killed, and come back"
echo "  a step ended $back ms after they were started"

# The clocks of trainer and workers are set an hour ahead, then two hours back.
export ITN_CLOCK_SHIFT_FILE=$folder/clock
tell() { (($(find "$folder" -name "clock.*.$1" | wc -l) >= 3)); }
begin clocks env LD_PRELOAD="$ITN_CLOCK_SHIFT"
for seconds in 3600 -3600; do
  echo "$seconds" >"$folder/new"
  mv "$folder/new" "$folder/clock"
  until_true "three processes tell another time" tell "$seconds"
  until_true "steps by another time" has_steps clocks $(($(steps_of clocks) + 3))
done
finish "clocks go an hour ahead, then two hours back"
! grep -i "deadline\|no answer\|lost\|next free worker" "$folder/log" ||
  fail "a jump of the clock was taken for a late answer"
