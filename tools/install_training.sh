#!/bin/sh
# Installs what training needs into a virtual environment: sh tools/install_training.sh FOLDER
# Called by the Makefile.
#
# PyPI's torch for Linux brings CUDA, 2.7 GB. Without an NVIDIA GPU the CPU build of the same version
# is taken, 0.2 GB, where pytorch.org can be reached: from there, and nothing else is. Whatever the
# build, its version is pinned, but its hash is the index's word; all else is known by hash.
set -eu

venv=$1
cpu_builds=https://download.pytorch.org/whl/cpu
torch=$(grep '^torch==' requirements/train.txt)

step() { sh tools/step.sh "$@"; }

is_reachable() {
  "$venv/bin/python" -c 'import sys, urllib.request
urllib.request.urlopen(sys.argv[1], timeout=5)' "$1" 2> /dev/null
}

brings_cuda() {
  "$venv/bin/python" -c 'import sys
from importlib.metadata import requires
sys.exit(not any(each.startswith(("nvidia", "cuda")) for each in requires("torch") or ()))'
}

set -- --no-deps "$torch"
if ! command -v nvidia-smi > /dev/null && is_reachable "$cpu_builds/torch/"; then
  set -- --index-url "$cpu_builds" "$@"
fi
step 'installing torch (0.2 GB to fetch, 2.7 GB with the CUDA that its build may need)' \
  "$venv/bin/python" -m pip install -qq "$@"
step 'installing what else training needs' sh tools/install_locked.sh "$venv" train
if brings_cuda; then
  step 'installing the CUDA that this build of torch needs' sh tools/install_locked.sh "$venv" cuda
fi
