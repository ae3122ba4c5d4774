#!/bin/sh
# Prints the folders of the packages that colcon is to build here: sh tools/packages_to_build.sh
# Called by the Makefile, with the paths of ROS set.
#
# tf2_msgs is among them only where no other prefix has it: the wheels of ROS 2 come without.
set -eu

paths='. msg_defs stand_ins/tf2_msgs'
saved=$IFS
IFS=:
for prefix in ${AMENT_PREFIX_PATH:-}; do
  case "$prefix" in
    "$PWD"/install | "$PWD"/install/*) ;; # what was built here before
    *) if [ -e "$prefix/share/tf2_msgs/package.xml" ]; then paths='. msg_defs'; fi ;;
  esac
done
IFS=$saved
echo "$paths"
