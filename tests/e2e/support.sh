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

# until_true WHAT COMMAND...: waits until the command succeeds, for two minutes at most, as long as
# the process $run lives, if there is one, whose messages are in $folder/log.
until_true() {
  local what=$1 i
  shift
  for i in {1..12000}; do
    "$@" && return
    kill -0 "${run:-$$}" 2>/dev/null || fail "the run ended before $what: $(tail -n 3 "$folder/log")"
    sleep 0.01
  done
  fail "$what: not within two minutes"
}

milliseconds() { echo $(($(date +%s%N) / 1000000)); }
# Of processor time that a process has used, in hundredths of a second.
cpu_ticks() { awk '{ print $14 + $15 }' "/proc/$1/stat"; }
