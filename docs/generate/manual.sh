#!/usr/bin/env bash
# Writes the pages of the manual, of what --help says: `man itn-render` and so on.
#
#   docs/generate/manual.sh PROGRAMS FOLDER     the folder of itn, itn-worker, itn-predictor; that of the pages
#
# Needs help2man.
set -euo pipefail
programs=$1 folder=$2
mkdir -p "$folder"
export PATH=$programs:$PATH
version=$(itn --version)

# The first line of a help text is the page's title.
page() {
  help2man --no-info --version-string="$version" --name="$($1 --help | sed -n 1p)" --output="$folder/${1// /-}.1" "$1"
}

for program in itn itn-worker itn-predictor; do page "$program"; done
itn --help | sed -n '/^Subcommands:/,$s/^  \([a-z]*\) .*/\1/p' | while read -r command; do page "itn $command"; done
