# What the end-to-end tests share: programs, a folder that is removed, servers that are stopped.
# Sourced with `set -euo pipefail` in force; needs ITN_BIN and ITN_SOURCE.
export PATH="$ITN_BIN:$PATH"
folder=$(mktemp -d)
servers=()

clean_up() {
  local server
  for server in "${servers[@]}"; do
    kill "$server" 2>/dev/null && wait "$server" 2>/dev/null || true
  done
  rm -rf "$folder"
}
trap clean_up EXIT

# start NAME COMMAND...: starts a server on a port of its choice; its address is then in $address,
# its process in $server.
start() {
  local name=$1
  shift
  "$@" --listen 127.0.0.1:0 --log-level warning >"$folder/$name.address" &
  server=$!
  servers+=("$server")
  local i
  for i in {1..1200}; do
    [[ -s $folder/$name.address ]] && break
    kill -0 "$server" || fail "$name did not start"
    sleep 0.1
  done
  address=$(<"$folder/$name.address")
  [[ -n $address ]] || fail "$name printed no address"
}

fail() {
  echo "FAILED: $*" >&2
  exit 1
}
