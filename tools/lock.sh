#!/bin/sh
# Writes requirements/locked/ anew: all that each part of the set-up installs, with the hashes of its
# files for any machine. Run it after a pin in requirements/ was changed: sh tools/lock.sh
#
# Versions come from requirements/ alone, so a second run changes nothing but hashes of files that
# were published meanwhile. torch has none: which build is taken depends on the machine, and not all
# are on one index.
set -eu

locked=requirements/locked
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
python3 -m venv "$tools"
"$tools/bin/pip" install -qq uv==0.13.9
index=$("$tools/bin/pip" config get global.index-url 2> /dev/null) || true

resolve() {
  "$tools/bin/uv" pip compile -q --universal --generate-hashes --no-header --no-annotate --no-config \
    --python-version 3.11 ${index:+--default-index "$index"} "$@"
}

lock() {
  name=$1
  shift
  resolve -c requirements/constraints.txt -c requirements/run.txt -c requirements/build.txt "$@" \
    > "$tools/all.txt"
  # colcon asks for plugins of pytest that "colcon test" alone uses; numba loads coverage where it is.
  leave "win32|^coverage==|^pytest-(cov|repeat|rerunfailures)==" "$tools/all.txt" > "$tools/$name.txt"
}

# Entries of a file whose names match, or do not.
pick() { awk -v names="$1" '/^[a-z]/ { is_kept = $0 ~ names } is_kept' "$2"; }
leave() { awk -v names="$1" '/^[a-z]/ { is_kept = $0 !~ names } is_kept' "$2"; }

own='requirements/run.txt requirements/build.txt'
lock sourced $own
lock wheels $own requirements/ros.txt
lock dev requirements/dev.txt requirements/pettingzoo.txt
lock train requirements/train.txt
lock cluster requirements/cluster.txt
lock documents requirements/documents.txt
resolve --no-deps requirements/ubuntu_24_04.txt > "$tools/ubuntu_24_04.txt"

mkdir -p "$locked"
rm -f "$locked"/*.txt
for name in sourced wheels dev cluster documents ubuntu_24_04; do cp "$tools/$name.txt" "$locked"; done
cuda='^(nvidia|cuda|triton)'
leave "$cuda|^torch==" "$tools/train.txt" > "$locked/train.txt"
pick "$cuda" "$tools/train.txt" > "$locked/cuda.txt"
pick '^setuptools==' "$tools/sourced.txt" > "$locked/setuptools.txt"
