#!/bin/sh
# Makes a virtual environment of ROS wheels a ROS prefix, as /opt/ros/jazzy is one:
#   sh tools/write_ros_prefix.sh .venv
# writes .venv/setup.{sh,bash,zsh} and .venv/local_setup.{sh,bash,zsh}; source one to build or fly.
set -eu

prefix=$(CDPATH='' cd -- "$1" && pwd)

script=$(cat <<END
# Written by tools/write_ros_prefix.sh: puts this environment on the paths of ROS.
_ros_prefix='$prefix'
END
cat <<'END'
case ":${AMENT_PREFIX_PATH:-}:" in
  *":$_ros_prefix:"*) ;;
  *) export AMENT_PREFIX_PATH="$_ros_prefix${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}" ;;
esac
case ":${CMAKE_PREFIX_PATH:-}:" in
  *":$_ros_prefix:"*) ;;
  *) export CMAKE_PREFIX_PATH="$_ros_prefix${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}" ;;
esac
case ":${PATH:-}:" in
  *":$_ros_prefix/bin:"*) ;;
  *) export PATH="$_ros_prefix/bin${PATH:+:$PATH}" ;;
esac
export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
unset _ros_prefix
END
)

for name in setup local_setup; do
  for shell in sh bash zsh; do
    printf '%s\n' "$script" > "$prefix/$name.$shell"
  done
done
