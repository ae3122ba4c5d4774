"""A discovery server of Fast DDS on this machine, as `fastdds discovery -i 0 -p PORT` is one.

The wheels lack that tool: here a participant is one by its profile. Run it with the port.
"""

import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

import rclpy

# The prefix is that of the server with id 0: clients know it by this.
_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com"><profiles>
  <participant profile_name="server" is_default_profile="true"><rtps>
    <prefix>44.53.00.5f.45.50.52.4f.53.49.4d.41</prefix>
    <builtin>
      <discovery_config><discoveryProtocol>SERVER</discoveryProtocol></discovery_config>
      <metatrafficUnicastLocatorList><locator>
        <udpv4><address>127.0.0.1</address><port>{port}</port></udpv4>
      </locator></metatrafficUnicastLocatorList>
    </builtin>
  </rtps></participant>
</profiles></dds>
"""


def main() -> None:
    with TemporaryDirectory() as folder:
        profile = Path(folder, 'server.xml')
        profile.write_text(_PROFILE.format(port=sys.argv[1]))
        os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
        os.environ.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)  # has a protocol of its own
        rclpy.init()
        node = rclpy.create_node('discovery_server')
        node.get_logger().info('serving')
        rclpy.spin(node)


if __name__ == '__main__':
    main()
