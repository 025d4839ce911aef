#!/usr/bin/env bash
# A disk that is full while a render, a dataset or a run is written, after any number of pages or of
# files: exit code 4 and a line that names the file and the reason, the file of before or none under
# every name, no temporary file; and where there is room again, the same command ends with the same
# bytes as where there always was.
set -euo pipefail

# The disk is a tmpfs that nobody else sees.
if [[ ${1:-} != --in-own-namespace ]]; then
  if ! unshare --mount mount -t tmpfs none /mnt 2>/dev/null; then
    echo "SKIPPED: no file systems can be mounted here"
    exit 77
  fi
  exec unshare --mount bash "$0" --in-own-namespace
fi
source "$ITN_SOURCE/tests/e2e/support.sh"
disk=$folder/disk
mkdir "$disk"
trap 'umount "$disk" 2>/dev/null || true; clean_up' EXIT

new_disk() {
  umount "$disk" 2>/dev/null || true
  mount -t tmpfs -o size=16m none "$disk"
}
# leave_pages N: all of the disk is taken but for N pages of 4 KiB.
leave_pages() {
  cat /dev/zero >"$disk/filler" 2>/dev/null || true
  truncate --size "-$(($1 * 4))K" "$disk/filler"
}
# leave_files N: there can be N more files and folders.
leave_files() {
  local used
  used=$(df --output=iused "$disk" | tail -n 1)
  mount -o "remount,nr_inodes=$((used + $1))" "$disk"
}
make_room() {
  rm -f "$disk/filler"
  mount -o remount,nr_inodes=100000 "$disk"
}
pages_of() { find "$1" -type f -printf '%s\n' | awk '{ n += int(($1 + 4095) / 4096) } END { print n }'; }

# ends_full WHAT COMMAND...: it ends as it should on a full disk, or for another $reason.
reason="No space left on device"
ends_full() {
  local what=$1 code=0
  shift
  "$@" >/dev/null 2>"$folder/errors" || code=$?
  ((code == 4)) || fail "$what: exit code $code rather than 4: $(tail -n 3 "$folder/errors")"
  grep -q "$disk/.*$reason" "$folder/errors" ||
    fail "$what: names no file, or no reason: $(tail -n 3 "$folder/errors")"
  [[ -z $(find "$disk" -name '*.tmp') ]] || fail "$what: left $(find "$disk" -name '*.tmp')"
}
# same_where_there WHAT FOLDER WHOLE: each file of the folder is as that in the other one.
same_where_there() {
  local file
  while read -r file; do
    cmp "$2/$file" "$3/$file" || fail "$1: another $file"
  done < <(cd "$2" && find . -type f)
}

echo "== A render"
render() {
  itn render "$ITN_SOURCE/client/examples/cube.textproto" -o "$1/cube.exr" --png "$1/cube.png" \
    --sigma-t 30 --albedo 0.8 --spp "${2:-2}"
}
mkdir "$folder/whole" "$folder/other"
render "$folder/whole" &>/dev/null
render "$folder/other" 1 &>/dev/null
new_disk
pages=$(pages_of "$folder/whole")
failures=0
for ((left = 0; left < pages; left += 1 + pages / 8)); do
  leave_pages "$left"
  ends_full "a render with $left pages left" render "$disk"
  rm "$disk/filler"
  same_where_there "a render with $left pages left" "$disk" "$folder/whole"
  rm -f "$disk/cube.exr" "$disk/cube.png"
  failures=$((failures + 1))
done
cp "$folder/other/cube.exr" "$disk"
leave_pages 1
ends_full "a render over another" render "$disk"
cmp "$disk/cube.exr" "$folder/other/cube.exr" || fail "the image of before is not there any more"
rm "$disk/cube.exr"
leave_files 0
ends_full "a render as one file too many" render "$disk"
make_room
small_files_alone() (
  ulimit -f 64
  render "$disk"
)
reason="File too large" ends_full "a render as a file that is too large for its user" small_files_alone
render "$disk" &>/dev/null
same_where_there "a render with room" "$folder/whole" "$disk"
echo "a render of $pages pages: $((failures + 3)) errors, then the same bytes"

# until_whole WHAT PAGES FILES COMMAND...: of what takes so many pages and files. With room for fewer, the
# command ends as it should on a full disk, and part_check is asked; with room again it goes on to its
# end, and whole_check is.
until_whole() {
  local what=$1 pages=$2 files=$3 left resource count=0
  shift 3
  for resource in pages files; do
    for ((left = 0; left < ${!resource}; left += 1 + ${!resource} / 8)); do
      new_disk
      "leave_$resource" "$left"
      ends_full "$what with $left $resource left" "$@"
      part_check "$what with $left $resource left"
      make_room
      "$@" >/dev/null 2>"$folder/errors" ||
        fail "$what with room after $left $resource: $(tail -n 3 "$folder/errors")"
      whole_check "$what with room after $left $resource"
      count=$((count + 1))
    done
  done
  echo "$what of $pages pages and $files files: $count errors, then the same bytes"
}

echo "== A dataset"
dataset() { itn dataset "$1" --count 8 --resolution 16 --spp 4 --threads 1; }
dataset "$folder/dataset" &>/dev/null
part_check() { [[ ! -e $disk/dataset ]] || same_where_there "$1" "$disk/dataset" "$folder/dataset"; }
whole_check() { diff -r "$folder/dataset" "$disk/dataset" || fail "$1: another dataset"; }
until_whole "a dataset" "$(pages_of "$folder/dataset")" "$(find "$folder/dataset" | wc -l)" \
  dataset "$disk/dataset"

echo "== A run"
itn dataset "$folder/images" --count 40 --resolution 16 --spp 4 &>/dev/null
train() {
  itn train "$folder/images" -o "$1" --steps 9 --checkpoint-every 2 --validate-every 3 --batch 8 \
    --base-channels 4 --lr 1e-3 --seed 3 --torch-threads 1 --threads 1 --model-name model
}
# Of the metrics, all but times.
contents() {
  (cd "$1" && sha256sum ./*.itn && sed -E 's/"seconds":[^,}]*//' metrics.jsonl)
}
train "$folder/run" &>/dev/null
contents "$folder/run" >"$folder/expected"
part_check() { :; }
whole_check() {
  contents "$disk/run" >"$folder/contents"
  diff "$folder/expected" "$folder/contents" || fail "$1: another run"
}
until_whole "a run" "$(pages_of "$folder/run")" "$(find "$folder/run" | wc -l)" train "$disk/run"
