#!/usr/bin/env bash
# A Slurm cluster of one node, of this test's own: deploy/slurm/itn.sbatch starts two workers as a
# job array for a training, the first is cancelled, a third one added, the second cancelled, too; and
# the weights are those of a training without workers.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"
PATH+=:/usr/sbin

for program in munged slurmctld slurmd sbatch flock; do
  if ! command -v "$program" >/dev/null; then
    echo "skipped: there is no $program (Debian: slurm-wlm)"
    exit 77
  fi
done

# eventually COMMAND...: waits until it succeeds, for a minute at most.
eventually() {
  local i
  for i in {1..600}; do
    "$@" >/dev/null 2>&1 && return
    sleep 0.1
  done
  return 1
}

# launch PROGRAM FLAGS...: it ends with the test, before those that were launched earlier.
launch() {
  "$@" >"$folder/$1.log" 2>&1 &
  servers=("$!" "${servers[@]}")
}

# The first of six ports in a row that nobody listens on.
free_ports() {
  local first port
  for first in $(shuf -i 20000-30000 -n 100); do
    for port in $(seq "$first" $((first + 5))); do
      (: <"/dev/tcp/127.0.0.1/$port") 2>/dev/null && continue 2
    done
    echo "$first"
    return
  done
  fail "no free ports"
}

node_is_idle() { [[ $(sinfo --noheader --format %T) == idle ]]; }
no_job_is_left() { [[ -z $(squeue --noheader) ]]; }

# Eight processors, however many there are; and no control groups: containers may have none.
start_cluster() {
  local host user port
  host=$(hostname -s)
  user=$(id -un)
  port=$(free_ports)
  export ITN_FIRST_PORT=$((port + 2))  # task 1 is the first
  export SLURM_CONF=$folder/slurm.conf
  cat >"$SLURM_CONF" <<CONF
ClusterName=itn
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
SlurmUser=$user
SlurmdUser=$user
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
NodeName=localhost NodeHostname=$host NodeAddr=127.0.0.1 CPUs=8 RealMemory=65536
PartitionName=main Nodes=localhost Default=YES MaxTime=10
CONF
  chmod 711 "$folder"  # munge wants its socket to be reachable
  mkdir "$folder/state" "$folder/spool"
  (umask 077 && head -c 1024 /dev/urandom >"$folder/munge.key")
  launch munged --foreground --num-threads=1 --key-file="$folder/munge.key" \
    --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
    --log-file="$folder/munged.log" --seed-file="$folder/munge.seed"
  eventually munge --no-input --socket="$folder/munge.socket" || fail "munged does not answer"
  launch slurmctld -D
  launch slurmd -D
  eventually node_is_idle || fail "no node: $(tail -n 5 "$folder"/slurm*.log)"
}

stop_cluster() {
  scancel --user="$(id -un)" || true
  eventually no_job_is_left || echo "jobs are left: $(squeue)" >&2
  clean_up
}

# add_workers TASKS: the number of the job is then in $job.
add_workers() {
  job=$(sbatch --parsable --chdir="$folder" --array="$1" --cpus-per-task=1 --mem=1G \
    "$ITN_SOURCE/deploy/slurm/itn.sbatch" --insecure)
}

export ITN_ADDRESSES=$folder/workers.txt
address() { echo "localhost:$((ITN_FIRST_PORT + $1))"; }
is_listed() { grep -qxF "$(address "$1")" "$ITN_ADDRESSES"; }
is_not_listed() { ! is_listed "$1"; }

train() {  # NAME FLAGS...
  local name=$1
  shift
  timeout --kill-after 5 300 itn train "$folder/dataset" -o "$folder/$name" --loss itn --steps 30 \
    --batch 8 --spp 512 --base-channels 4 --lr 1e-3 --seed 3 --torch-threads 1 \
    --model-name model "$@" 2>"$folder/$name.log" || fail "training $name: $(tail -n 3 "$folder/$name.log")"
}
weights() { sha256sum <"$folder/$1/checkpoint.itn"; }
steps() { cat "$folder/cluster/metrics.jsonl" 2>/dev/null | wc -l; }
has_taken() { (($(steps) >= $1)); }

itn dataset "$folder/dataset" --count 16 --resolution 16 --spp 4 2>/dev/null
train embedded --threads 2

trap stop_cluster EXIT
start_cluster
add_workers 1-2
first=$job
eventually is_listed 1 && eventually is_listed 2 || fail "no workers: $(cat "$folder"/*.log)"

# The client knows the third worker's address already; there is nobody yet.
train cluster --workers "$(address 1),$(address 2),$(address 3)" &
training=$!
eventually has_taken 3 || fail "training does not begin: $(cat "$folder/cluster.log")"
scancel "${first}_1"
eventually is_not_listed 1 || fail "a worker that was cancelled is still listed"
add_workers 3
eventually is_listed 3 || fail "no third worker: $(cat "$folder"/*.log)"
scancel "${first}_2"  # what is left is the third worker's
eventually is_not_listed 2 || fail "a worker that was cancelled is still listed"
before=$(steps)
((before < 30)) || fail "training was over before the third worker was alone"
wait "$training" || fail "training with workers failed"
[[ $(weights cluster) == "$(weights embedded)" ]] || fail "other weights than without workers"
for log in "$folder"/itn-worker-"${first}"_*.log; do
  grep -q " stopped$" "$log" || fail "a worker that was cancelled did not finish: $(cat "$log")"
done
echo "one worker cancelled at step 3, its substitute alone from step $before on: the same weights"
