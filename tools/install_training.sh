#!/bin/sh
# Installs what training needs into a virtual environment: sh tools/install_training.sh FOLDER
# Called by the Makefile.
#
# PyPI's torch for Linux brings CUDA, 2.7 GB. Without an NVIDIA GPU the CPU build of the same version
# is taken, 0.2 GB, where pytorch.org can be reached. pip prefers that build wherever it finds it.
set -eu

venv=$1
cpu_builds=https://download.pytorch.org/whl/cpu
torch=$(grep '^torch==' requirements/train.txt)

is_reachable() {
  "$venv/bin/python" -c 'import sys, urllib.request
urllib.request.urlopen(sys.argv[1], timeout=5)' "$1" 2> /dev/null
}

install() {
  "$venv/bin/python" -m pip install -qq -c requirements/constraints.txt "$@"
}

echo 'set-up: installing torch and what else training needs (0.2 GB to fetch, 2.7 GB with CUDA)'
if ! command -v nvidia-smi > /dev/null && is_reachable "$cpu_builds/torch/"; then
  install --no-deps --extra-index-url "$cpu_builds" "$torch"
fi
install -r requirements/train.txt
