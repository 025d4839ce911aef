#!/usr/bin/env bash
# A training whose workers are on other hosts (network namespaces): on the far side of slow links, and
# of a link that goes down and comes back. The weights, and the metrics of every step, are those of the
# training without workers.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"
source "$ITN_SOURCE/tests/e2e/network.sh"
source "$ITN_SOURCE/tests/e2e/training.sh"

worker "$host_a" 1
worker_a=$server
worker "$host_b" 2
worker_b=$server
begin() {
  begin_training "$1" ip netns exec "$client" --workers 10.213.1.2:50051,10.213.2.2:50051
}

begin undisturbed-by-the-network
finish "two hosts, nothing happens"

# Its renders are heard of no more, and go to the other worker; when the link is back, so is the worker.
begin partition
ip -n "$client" link set veth1 down
until_true "steps without the link" has_steps partition $(($(steps_of partition) + 6))
busy=$(cpu_ticks "$worker_a")
renders() { (($(cpu_ticks "$worker_a") > busy + 5)); }
ip -n "$client" link set veth1 up
until_true "the worker behind the link renders again" renders
finish "a link goes down, and comes back"

# With all of them down the training waits.
begin split
ip -n "$client" link set veth1 down
ip -n "$client" link set veth2 down
until_true "the training misses its workers" grep -q . "$folder/log"
seen=$(steps_of split)
ip -n "$client" link set veth1 up
ip -n "$client" link set veth2 up
back=$(milliseconds)
until_true "steps with links that are up" has_steps split $((seen + 1))
back=$(($(milliseconds) - back))
finish "all links go down, and come back"
echo "  a step ended $back ms after they were up"

# slow QDISC...: both directions of the first link.
slow() {
  tc -n "$client" qdisc add dev veth1 root "$@" &&
    tc -n "$host_a" qdisc add dev eth0 root "$@"
} 2>"$folder/tc.log"
if slow netem delay 150ms 30ms loss 1% rate 4mbit; then
  how="150 ms, 1 % lost, 4 Mbit/s"
elif slow tbf rate 500kbit burst 3kb latency 2s; then
  how="500 kbit/s"  # without netem nothing is late or lost by itself
else
  echo "skipped: no slow link: neither netem nor tbf is here: $(tail -n 1 "$folder/tc.log")"
  exit 77
fi
# The worker behind it has none of the scenes yet.
kill -KILL "$worker_a"
wait "$worker_a" 2>/dev/null || true
worker "$host_a" 1
begin slow
finish "a slow link ($how)"
