#!/usr/bin/env bash
# Installs what itn is built with and tested with, where it is missing. Debian 12 (or a later Debian
# or Ubuntu that has these packages). Uses sudo when not run by root; does nothing, and takes no
# time, when everything is there.
set -euo pipefail

packages=(
  # Compiler and build
  g++ cmake ninja-build ccache git ca-certificates pkg-config
  # Services
  libgrpc++-dev protobuf-compiler protobuf-compiler-grpc libprotobuf-dev libssl-dev
  # Rendering
  libembree-dev libhwy-dev libeigen3-dev
  # Random shapes
  libmeshoptimizer-dev
  # Scenes of other programs
  libpugixml-dev
  # Learning; without an optimised BLAS, LibTorch is some thirty times slower
  libtorch-dev libopenblas0-pthread libopencv-imgproc-dev
  # Images
  libopenexr-dev libpng-dev zlib1g-dev libopenimageio-dev libheif-dev liblcms2-dev libopencv-photo-dev
  # Command line and logs
  libcli11-dev libfmt-dev libspdlog-dev
  # Tests
  libgtest-dev libgmock-dev clang-format clang-tidy
  # Pages of the manual
  help2man
  # Certificates for tests and trials
  openssl
  # The Python package, and the client in another language that the tests run
  python3 python3-dev python3-venv python3-grpcio python3-protobuf python3-numpy python3-torch
)

missing() {
  local package
  for package in "${packages[@]}"; do
    [[ $(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null) == installed ]] ||
      echo "$package"
  done
}

if ! command -v apt-get dpkg-query >/dev/null; then
  cat >&2 <<EOF
bootstrap.sh: this is not Debian or Ubuntu. Install the equivalents of these packages, then run
deploy/build.sh:
  ${packages[*]}
EOF
  exit 1
fi

mapfile -t wanted < <(missing)
if ((${#wanted[@]} > 0)); then
  as_root=()
  if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
      echo "bootstrap.sh: run this as root, or install sudo: packages are missing: ${wanted[*]}" >&2
      exit 1
    fi
    as_root=(sudo)
  fi
  echo "Installing: ${wanted[*]}"
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -qq -y --no-install-recommends "${wanted[@]}"
fi

# What the Python package is compiled and checked with, in a folder of its own: Debian 12 does not have
# it.
python=$(dirname "${BASH_SOURCE[0]}")/../build/python
wanted="nanobind==3.1.0 mypy==2.4.1"
if [[ $(cat "$python/installed" 2>/dev/null) != "$wanted" ]]; then
  echo "Installing into build/python: $wanted"
  /usr/bin/python3 -m venv --system-site-packages "$python"
  # shellcheck disable=SC2086
  "$python/bin/pip" install -q --disable-pip-version-check $wanted
  echo "$wanted" >"$python/installed"
fi
