#!/bin/sh
# Makes or updates the virtual environment: sh tools/make_venv.sh FOLDER KIND [PYTHON]
# KIND is "wheels" (ROS 2 Jazzy comes from requirements/ros.txt, the folder becomes a ROS prefix) or
# "sourced" (the Jazzy of this shell is used). Called by the Makefile.
set -eu

venv=$1
kind=$2
python=${3:-}

say() { echo "set-up: $*"; }
step() { sh tools/step.sh "$@"; }
die() { echo "set-up: $*" >&2; exit 1; }

# The interpreter itself, should a virtual environment be active: ours may have to be made anew.
find_python() {
  for candidate in ${python:-python3 python3.12 python3.11}; do
    "$candidate" -c 'import sys
sys.version_info[:2] in ((3, 11), (3, 12)) or sys.exit(1)
print(sys._base_executable)' 2> /dev/null && return
  done
}

check_machine() {
  # ROS's CMake files take other bytes for the end of a path, make and shells some signs for theirs.
  here=$(printf '%s' "$PWD" | tr '\n' ' ')
  if printf '%s' "$here" | LC_ALL=C grep -q '[^A-Za-z0-9/._+@,=~-]'; then
    die "the path of the repository must be of A-Z, a-z, 0-9 and . _ + @ , = ~ - only: $here"
  fi
  case "$kind-${ROS_DISTRO:-}" in
    wheels- | *-jazzy) ;;
    *) die "ROS $ROS_DISTRO is sourced; use a shell with Jazzy or without ROS" ;;
  esac
  found=$(find_python) || true
  [ -n "$found" ] || die "needs Python 3.11 or 3.12 (${python:-python3, python3.12, python3.11} tried);" \
    "name it with make PYTHON=/path/to/python"
  "$found" -c 'import ensurepip, venv' 2> /dev/null \
    || die "$found has no venv module (Debian and Ubuntu: apt install python3-venv)"
  "$found" -c 'import os, sysconfig as s; os.stat(s.get_path("include") + "/Python.h")' 2> /dev/null \
    || die "$found has no headers, Python.h (Debian and Ubuntu: apt install python3-dev)"
  command -v "${CXX:-c++}" > /dev/null \
    || die "there is no C++ compiler, ${CXX:-c++} (Debian and Ubuntu: apt install g++)"
  if [ "$kind" = sourced ]; then
    "$found" -c 'import rclpy' 2> /dev/null || die "$found cannot import rclpy of the sourced Jazzy;" \
      "name its Python with make PYTHON=/path/to/python, or use a shell without ROS"
  fi
}

make_folder() {
  if [ "$(cat "$venv/kind" 2> /dev/null)" = "$kind" ] && "$venv/bin/python" -m pip --version \
      > /dev/null 2>&1; then
    return
  fi
  say "making $venv with $("$found" --version)"
  rm -rf build install # built with another Python or another ROS
  if [ "$kind" = sourced ]; then
    "$found" -m venv --clear --system-site-packages "$venv"
  else
    "$found" -m venv --clear "$venv"
  fi
  echo "$kind" > "$venv/kind"
}

install_packages() {
  # What is published as source alone is built by this setuptools, not by one that pip would fetch.
  step 'installing setuptools' sh tools/install_locked.sh "$venv" setuptools
  # Bytecode is compiled afterwards, on all cores: pip compiles on one.
  step 'installing the packages of requirements/ (0.4 GB to fetch, about a minute)' \
    sh tools/install_locked.sh "$venv" "$kind" --no-compile --no-build-isolation
  step 'compiling their Python files on all cores (about a minute)' \
    "$venv/bin/python" -m compileall -qq -j 0 "$venv/lib" || true # templates are no Python
}

check_machine
make_folder
install_packages
sh tools/link_package.sh "$venv"
[ "$kind" = sourced ] || sh tools/write_ros_prefix.sh "$venv"
