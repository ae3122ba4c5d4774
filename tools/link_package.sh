#!/bin/sh
# Lets the Python of a virtual environment import this repository's package from anywhere, with no
# setup.sh sourced: sh tools/link_package.sh .venv
set -eu

packages=$("$1/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
CDPATH='' cd -- "$(dirname -- "$0")/.."
pwd > "$packages/uav_collect.pth"
