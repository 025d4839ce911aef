#!/usr/bin/env bash
# Two workers and a predictor that want certificates and a token: every kind of client renders and
# predicts as without, none does without what they want, and new certificates are taken up.
set -euo pipefail
source "$ITN_SOURCE/tests/e2e/support.sh"

if ! command -v openssl >/dev/null; then
  echo "skipped: needs openssl"
  exit 77
fi

# fails CODE TEXT COMMAND...: one line on stderr that has the text, and this exit code.
fails() {
  local code=$1 text=$2 result=0
  shift 2
  "$@" >/dev/null 2>"$folder/errors" || result=$?
  [[ $result == "$code" ]] || fail "exit code $result rather than $code: $(<"$folder/errors")"
  grep -qF -- "$text" "$folder/errors" || fail "no \"$text\" in: $(<"$folder/errors")"
}

ca=$folder/ca
"$ITN_SOURCE/deploy/make-test-ca.sh" "$ca" >/dev/null
openssl rand -hex 32 >"$folder/token"
secured=(--tls-cert "$ca/server.pem" --tls-key "$ca/server.key" --tls-client-ca "$ca/ca.pem"
         --token-file "$folder/token")
known=(--tls-ca "$ca/ca.pem" --tls-cert "$ca/client.pem" --tls-key "$ca/client.key")

echo "== Servers that do not start"
fails 2 "--insecure" itn-worker --listen 0.0.0.0:0
fails 2 "--insecure" itn-worker --listen "[::]:0"
fails 2 "--tls-key" itn-worker --listen 127.0.0.1:0 --tls-cert "$ca/server.pem"
fails 2 "--tls-cert" itn-worker --listen 127.0.0.1:0 --tls-client-ca "$ca/ca.pem"
fails 3 "is not that of the certificate" \
  itn-worker --listen 127.0.0.1:0 --tls-cert "$ca/server.pem" --tls-key "$ca/client.key"
fails 4 "cannot read the certificate" \
  itn-worker --listen 127.0.0.1:0 --tls-cert "$ca/none.pem" --tls-key "$ca/server.key"
fails 2 "names no file" itn-worker --listen 127.0.0.1:0 --token-file ""
fails 4 "cannot read the token file" itn-worker --listen 127.0.0.1:0 --token-file "$folder/none"

echo "== Two workers"
start one itn-worker "${secured[@]}"
one=$address
start two itn-worker "${secured[@]}"
two=$address
render() {
  itn render "$ITN_SOURCE/client/examples/cube.textproto" -o "$1" --sigma-t 30 --albedo 0.8 --g 0.3 \
    --spp 16 "${@:2}"
}
render "$folder/here.exr"
render "$folder/there.exr" --workers "$one,$two" "${known[@]}" --token-file "$folder/token"
cmp "$folder/here.exr" "$folder/there.exr"
ITN_TLS_CA=$ca/ca.pem ITN_TLS_CERT=$ca/client.pem ITN_TLS_KEY=$ca/client.key \
  ITN_TOKEN_FILE=$folder/token render "$folder/environment.exr" --workers "$one"
cmp "$folder/here.exr" "$folder/environment.exr"

echo "== Clients that do not get through"
fails 5 "give --tls-ca" render "$folder/no.exr" --workers "$one"
fails 5 "give --tls-cert and --tls-key" render "$folder/no.exr" --workers "$one" --tls-ca "$ca/ca.pem"
fails 5 "wants a token" render "$folder/no.exr" --workers "$one" "${known[@]}"
fails 2 "without --tls-ca" render "$folder/no.exr" --workers "$one" \
  --tls-cert "$ca/client.pem" --tls-key "$ca/client.key"
fails 2 "unencrypted" render "$folder/no.exr" --workers 192.0.2.1:1 --token-file "$folder/token"
[[ ! -e $folder/no.exr ]] || fail "something was rendered"

echo "== Probes"
[[ $(itn probe "$one" "${known[@]}") == SERVING ]] || fail "not serving"
[[ $(itn probe "$two" --service itn.v1.RenderService "${known[@]}") == SERVING ]] || fail "not serving"
fails 5 "give --tls-cert and --tls-key" itn probe "$one" --tls-ca "$ca/ca.pem"
fails 5 "if the server encrypts its connections" itn probe "$one"

echo "== A predictor"
itn dataset "$folder/dataset" --count 16 --resolution 16 --spp 4 2>/dev/null
itn train "$folder/dataset" -o "$folder/run" --steps 2 --batch 4 --base-channels 4 2>/dev/null
start predictor itn-predictor --model "$folder/run" "${secured[@]}"
predictor=$address
image=$(find "$folder/dataset" -name '*.exr' | sort | head -1)
itn predict "$image" --model "$folder/run" --json >"$folder/here.json"
itn predict "$image" --predictor "$predictor" "${known[@]}" --token-file "$folder/token" --json \
  >"$folder/there.json"
cmp "$folder/here.json" "$folder/there.json"
fails 5 "wants a token" itn predict "$image" --predictor "$predictor" "${known[@]}"

if /usr/bin/python3 -c 'import grpc, numpy, google.protobuf' && command -v grpc_python_plugin >/dev/null; then
  echo "== Python"
  client=("$ITN_SOURCE/client/examples/itn_client.py" --worker "$one" --predictor "$predictor")
  "${client[@]}" "${known[@]}" --token-file "$folder/token" >/dev/null
  fails 5 "wants a token" "${client[@]}" "${known[@]}"
  fails 5 "worker $one" "${client[@]}"
fi

echo "== Certificates of another authority, while they serve"
"$ITN_SOURCE/deploy/make-test-ca.sh" "$folder/next" >/dev/null
cp "$folder/next/"* "$ca/"
for server in "$one" "$two" "$predictor"; do
  [[ $(itn probe "$server" --tls-ca "$folder/next/ca.pem" --tls-cert "$folder/next/client.pem" \
    --tls-key "$folder/next/client.key") == SERVING ]] || fail "$server has the former certificate"
done
