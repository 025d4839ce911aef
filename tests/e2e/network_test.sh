#!/usr/bin/env bash
# Workers on two hosts (network namespaces) behind a name whose addresses change during a run: one
# that joins gets renders, and a link that goes down loses nothing. The images are the same, bit for
# bit, as those of a dataset that is rendered without workers.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"
source "$ITN_SOURCE/tests/e2e/network.sh"

# name ADDRESS...: what the name "workers" means to the client from now on.
name() {
  { echo "127.0.0.1 localhost" && printf '%s workers\n' "$@"; } >"/etc/netns/$client/hosts"
}
name 10.213.1.2

# Far more images, of about a fifth of a second, than there is time for: the run is ended when all has
# happened.
begin=$(date +%s%N)
itn dataset "$folder/trial" --count 20 --resolution 32 --spp 2048 --threads 2 2>/dev/null
dataset=(--count 10000 --resolution 32 --seed 5
  --spp $((200000000 * 20 * 2048 / ($(date +%s%N) - begin))))

images() { find "$folder/dataset" -name '*.exr' 2>/dev/null | wc -l; }
more_images_than() { (($(images) > $1)); }
said() { grep -q -- "$1" "$folder/log"; }
works() { (($(cpu_ticks "$1") > $2)); }

worker "$host_a" 1
worker_a=$server
worker "$host_b" 2
worker_b=$server

ip netns exec "$client" itn dataset "$folder/dataset" "${dataset[@]}" \
  --workers dns:///workers:50051 2>"$folder/log" &
run=$!
servers+=("$run")
until_true "the first images" more_images_than 3

# The name gets a second address. What a worker uses before its first render is its start.
idle=$(cpu_ticks "$worker_b")
begin=$(milliseconds)
name 10.213.1.2 10.213.2.2
until_true "a worker that joins renders" works "$worker_b" $((idle + 5))
joined=$(($(milliseconds) - begin))

# The link to the first worker goes down: its renders are heard of no more. Images are written in
# their order, so that one which is lost holds up the others until it is rendered elsewhere.
ip -n "$client" link set veth1 down
longest=0 last=$(milliseconds) seen=$(images)
for _ in {1..20}; do
  until_true "images without the link" more_images_than "$seen"
  now=$(milliseconds)
  ((now - last <= longest)) || longest=$((now - last))
  last=$now seen=$(images)
done

# It comes back, and the worker with it.
busy=$(cpu_ticks "$worker_a")
begin=$(milliseconds)
ip -n "$client" link set veth1 up
until_true "the first worker renders again" works "$worker_a" $((busy + 5))
back=$(($(milliseconds) - begin))

# The name loses the second address: that worker gets nothing more.
name 10.213.1.2
until_true "the second worker has left" said "worker 10.213.2.2:50051 is not on the list any more"

# end RUN: interrupts it.
end() {
  kill -TERM "$1"
  local code=0
  wait "$1" || code=$?
  ((code == 130)) || fail "an interrupted run ended with $code: $(tail -n 3 "$folder/log")"
}
end "$run"
count=$(images)
mv "$folder/dataset" "$folder/by_workers"
itn dataset "$folder/dataset" "${dataset[@]}" --threads 2 2>"$folder/log" &
run=$!
servers+=("$run")
until_true "as many images without workers" more_images_than "$count"
end "$run"
cd "$folder/by_workers/images"
for image in *.exr; do
  cmp "$image" "$folder/dataset/images/$image" || fail "another image: $image"
done
echo "the same $count images; joined after $joined ms; link down: no image for" \
  "$longest ms at most; link up: renders again after $back ms"
