#!/usr/bin/env bash
# Makes certificates to try TLS out with: an authority, one for servers and one for clients.
#
#   deploy/make-test-ca.sh FOLDER [NAME...]
#
# NAME: a host's name or IP address that clients will use for a server; localhost, 127.0.0.1 and ::1
# are always among them. Writes into the folder
#
#   ca.pem                   the authority's certificate     --tls-ca, --tls-client-ca
#   server.pem, server.key   for every server                --tls-cert, --tls-key of servers
#   client.pem, client.key   for every client                --tls-cert, --tls-key of clients
#   ca.key                   signs further ones              keep it off the servers
#
# Valid for 15 days, the authority for 30. One that is in the folder already is kept: run this again
# to renew the others, which servers and clients take up as they run.
#
# For tests and trials: all servers share a key, and nothing can be revoked. A lab that has an
# authority of its own uses that.
set -euo pipefail

if (($# == 0)) || [[ $1 == -* ]]; then
  sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}" >&2
  exit 2
fi
if ! command -v openssl >/dev/null; then
  echo "make-test-ca.sh: needs the program openssl (Debian: apt-get install openssl)" >&2
  exit 1
fi
folder=$1
shift
days=30

names="DNS:localhost,IP:127.0.0.1,IP:::1"
for name in "$@"; do
  if [[ ! $name =~ ^[A-Za-z0-9.:*-]+$ ]]; then
    echo "make-test-ca.sh: \"$name\" is neither a name nor an IP address" >&2
    exit 2
  fi
  if [[ $name == *:* || $name =~ ^[0-9]+(\.[0-9]+){3}$ ]]; then
    names+=",IP:$name"
  else
    names+=",DNS:$name"
  fi
done

# Keys are for their owner alone.
umask 077
mkdir -p "$folder"
cd "$folder"

# quietly COMMAND...: what it says on stderr is shown only if it fails.
quietly() {
  local said
  said=$("$@" 2>&1 >/dev/null) || {
    echo "make-test-ca.sh: $* failed: $said" >&2
    exit 1
  }
}

new_key() { quietly openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1"; }

# signed NAME USAGE EXTENSION...: NAME.pem and NAME.key, each there as a whole at any moment.
signed() {
  local name=$1 usage=$2
  shift 2
  new_key "new-$name.key"
  quietly openssl req -new -key "new-$name.key" -subj "/CN=itn test $name" -out "$name.csr"
  printf '%s\n' "basicConstraints=critical,CA:FALSE" "keyUsage=critical,digitalSignature" \
    "extendedKeyUsage=$usage" "$@" >extensions
  quietly openssl x509 -req -in "$name.csr" -CA ca.pem -CAkey ca.key \
    -set_serial "0x$(openssl rand -hex 16)" -sha256 -days "$((days / 2))" -extfile extensions -out "new-$name.pem"
  mv "new-$name.key" "$name.key"
  chmod 644 "new-$name.pem"
  mv "new-$name.pem" "$name.pem"
  rm "$name.csr" extensions
}

if [[ ! -e ca.key ]]; then
  new_key ca.key
  quietly openssl req -x509 -new -key ca.key -sha256 -days "$days" -subj "/CN=itn test authority" \
    -addext "keyUsage=critical,keyCertSign,cRLSign" -out ca.pem
  chmod 644 ca.pem
fi

if ! openssl x509 -in ca.pem -noout -checkend $((days * 24 * 3600 / 2)) >/dev/null; then
  echo "make-test-ca.sh: the authority in $folder ends in less than $((days / 2)) days: remove the" \
    "folder, or give another one" >&2
  exit 1
fi

signed server serverAuth "subjectAltName=$names"
signed client clientAuth

echo "$PWD: ca.pem, server.pem and client.pem with their keys, valid for $((days / 2)) days; for tests alone"
