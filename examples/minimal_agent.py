"""Flies one UAV with nothing but rclpy and the messages: python minimal_agent.py UAV.

It collects where data waits and flies to the nearest cell that may still hold some, then home. It
knows of no way around cells where no UAV may fly, and does not look at its energy: where that runs
out, the world flies the UAV home.
"""

from collections import defaultdict
import math
import sys
import uuid

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from uav_collect_msgs.msg import Command, Observation, RadioMessage, Scenario
from uav_collect_msgs.srv import Join
import yaml

LATCHED = QoSProfile(depth=3000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ALIVE = QoSProfile(depth=3000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ALIVE.liveliness = LivelinessPolicy.AUTOMATIC
ALIVE.liveliness_lease_duration = Duration(seconds=2)  # the world matches nobody who offers none
STEPS = {Command.FORWARD: (1, 0), Command.RIGHT: (0, 1)}  # rows north, columns east
SIZES = 'rows', 'columns'  # of the area; or cells_per_side, of a square
STEPS |= {Command.BACKWARD: (-1, 0), Command.LEFT: (0, -1)}


class MinimalAgent(Node):
    def __init__(self, uav):
        super().__init__('minimal_agent', namespace=f'uav_{uav}')
        self.uav, self.instance = uav, str(uuid.uuid4())
        self.empty = set()  # cells that everybody knows to hold no data
        self.complete = defaultdict(lambda: set(self.empty))  # those without data, by mission
        self.commands = self.create_publisher(Command, 'command', ALIVE)
        self.radio = self.create_publisher(RadioMessage, 'radio_tx', ALIVE)
        self.client = self.create_client(Join, '/world/join')
        self.create_subscription(Scenario, '/world/scenario', self.join, LATCHED)
        self.create_subscription(RadioMessage, 'radio_rx', self.hear, LATCHED)

    def join(self, scenario):
        request = Join.Request(world_instance=scenario.world_instance, uav=self.uav)
        request.agent_instance, request.policy = self.instance, 'minimal'
        request.scenario_fingerprint = scenario.fingerprint
        self.client.wait_for_service()
        answer = self.client.call_async(request)
        answer.add_done_callback(lambda future: self.greet(future.result(), scenario))

    def greet(self, answer, scenario):
        if not answer.accepted:  # of a recording that is played back, say
            self.get_logger().warning(answer.reason)
            return
        values = yaml.safe_load(scenario.yaml)
        area, size = values['area'], values['area']['cell_size_m']
        rows, self.columns = (area.get(key, area.get('cells_per_side')) for key in SIZES)
        self.cells = range(rows * self.columns)
        if values['demand'].get('known_empty') == 'sensors':
            places = zip(scenario.sensor_y_m, scenario.sensor_x_m, strict=True)
            full = {int(north / size) * self.columns + int(east / size) for north, east in places}
            self.empty = {*self.cells} - full
        self.hz = values['radio']['system_bandwidth_mhz'] * 1e6 / scenario.n_uavs
        self.commands.publish(Command(agent_instance=self.instance, action=Command.ACTION_NONE))
        if not hasattr(self, 'seen'):
            self.seen = self.create_subscription(Observation, 'observation', self.decide, LATCHED)

    def hear(self, said):
        bits = int.from_bytes(bytes(said.complete), 'little')
        self.complete[said.mission_id] |= {c for c in range(bits.bit_length()) if bits >> c & 1}

    def decide(self, seen):
        complete, (row, column) = self.complete[seen.mission_id], divmod(seen.cell, self.columns)
        for index, bit in enumerate(seen.region_demand_bit):
            north, east = row + index // 3 - 1, column + index % 3 - 1
            cell = north * self.columns + east if 0 <= east < self.columns else -1
            if cell in self.cells and not bit > 0.0:  # nan where no UAV may fly
                complete.add(cell)
        said = RadioMessage(stamp=seen.stamp, mission_id=seen.mission_id, sender=self.uav)
        said.sequence, said.time_s, said.x_m, said.y_m = (
            seen.decision, seen.time_s, seen.x_m, seen.y_m)  # fmt: skip
        bits = sum(1 << cell for cell in complete)
        said.complete = bits.to_bytes((len(self.cells) + 7) // 8, 'little')
        self.radio.publish(said)
        answer = Command(stamp=seen.stamp, mission_id=seen.mission_id, decision=seen.decision)
        answer.agent_instance, answer.action = self.instance, self.way(complete, seen)
        if len(seen.sensor):
            answer.action, answer.sensor = Command.HOVER, seen.sensor
            answer.bandwidth_hz = [self.hz / len(seen.sensor)] * len(seen.sensor)
        self.commands.publish(answer)

    def way(self, complete, seen):
        targets = [divmod(c, self.columns) for c in self.cells if c not in complete]
        best, least = Command.RETURN_HOME, 2 * len(self.cells)
        for move, (north, east) in STEPS.items() if targets else ():
            row, column = seen.cell // self.columns + north, seen.cell % self.columns + east
            is_back = STEPS.get(seen.previous_action) == (-north, -east)  # not straight away
            is_closed = math.isnan(seen.region_demand_bit[4 + 3 * north + east])
            if not is_closed and not is_back:
                far = min(abs(row - r) + abs(column - c) for r, c in targets)
                best, least = (move, far) if far < least else (best, least)
        return best


rclpy.init()
rclpy.spin(MinimalAgent(int(sys.argv[1])))
