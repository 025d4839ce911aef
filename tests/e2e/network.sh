# A client and two workers' hosts in network namespaces of their own. Sourced after support.sh; ends a
# test as skipped where there can be none.
client=itn-client-$$ host_a=itn-a-$$ host_b=itn-b-$$
remove_network() {
  local namespace
  for namespace in "$client" "$host_a" "$host_b"; do
    ip netns delete "$namespace" 2>/dev/null || true
  done
  rm -rf "/etc/netns/$client"
}
trap 'clean_up; remove_network' EXIT

# host NAMESPACE NUMBER: a host at 10.213.NUMBER.2, with a link of its own to the client.
host() {
  ip netns add "$1"
  ip link add "veth$2" netns "$client" type veth peer name eth0 netns "$1"
  ip -n "$client" address add "10.213.$2.1/24" dev "veth$2"
  ip -n "$1" address add "10.213.$2.2/24" dev eth0
  ip -n "$client" link set "veth$2" up
  ip -n "$1" link set eth0 up
}
if ! { ip netns add "$client" && host "$host_a" 1 && host "$host_b" 2 &&
  ip -n "$client" link set lo up && mkdir -p "/etc/netns/$client"; } 2>"$folder/network.log"; then
  echo "SKIPPED: no network namespaces here: $(tail -n 1 "$folder/network.log")"
  exit 77
fi

insecure=()
itn-worker --help | grep -q -- --insecure && insecure=(--insecure)
# worker NAMESPACE NUMBER: its process is then in $server.
worker() {
  rm -f "$folder/worker$2.address"
  ip netns exec "$1" itn-worker --listen "10.213.$2.2:50051" --threads 1 --log-level warning \
    "${insecure[@]}" >"$folder/worker$2.address" &
  server=$!
  servers+=("$server")
  until_true "worker $2 listens" test -s "$folder/worker$2.address"
}
