#!/bin/sh
# Runs a command of uav-collect, or a node of lib/uav_collect, with the paths of ROS set:
#   sh tools/in_ros.sh mission --policy sweep
#   sh tools/in_ros.sh uav_agent --id 1
set -eu

root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
set +u
. "$root/install/setup.sh"
set -u
here=$root/install/uav_collect/lib/uav_collect
if [ -x "$here/${1:-}" ] && [ -f "$here/${1:-}" ]; then
  node=$1
  shift
  exec "$here/$node" "$@"
fi
exec "$here/uav-collect" "$@"
