#!/bin/sh
# Starts the node by whose name this is called, with the Python that it was installed for. A wheel
# has it as lib/uav_collect/NODE of an environment, for "ros2 run uav_collect NODE".
node=${0##*/}
prefix=$(CDPATH='' cd -- "${0%/*}/../.." && pwd)
python=$prefix/bin/python3
case ":${AMENT_PREFIX_PATH:-}:" in # where ROS finds messages; nobody had to source anything
  *":$prefix:"*) ;;
  *) export AMENT_PREFIX_PATH="$prefix${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}" ;;
esac
[ -x "$python" ] || python=python3
exec "$python" -c "import sys
from uav_collect.nodes import executables
sys.exit(executables.$node())" "$@"
