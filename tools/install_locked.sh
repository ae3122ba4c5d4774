#!/bin/sh
# Installs what a file of requirements/locked/ lists, each file of it known by its hash:
# sh tools/install_locked.sh FOLDER NAME [PIP OPTION ...]
set -eu

venv=$1
name=$2
shift 2
"$venv/bin/python" -m pip install -qq --no-deps --require-hashes "$@" -r "requirements/locked/$name.txt"
