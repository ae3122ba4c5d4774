"""Flies one UAV with nothing but rclpy and the messages: python minimal_agent.py UAV.

It collects where data waits and flies to the nearest cell that may still hold some, then home. It
does not look at its energy: where that runs out, the world flies the UAV home.
"""

from collections import defaultdict
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
STEPS |= {Command.BACKWARD: (-1, 0), Command.LEFT: (0, -1)}


class MinimalAgent(Node):
    def __init__(self, uav):
        super().__init__('minimal_agent', namespace=f'uav_{uav}')
        self.uav, self.instance = uav, str(uuid.uuid4())
        self.complete = defaultdict(set)  # cells without data, by mission
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
        self.side = values['area']['cells_per_side']
        self.hz = values['radio']['system_bandwidth_mhz'] * 1e6 / scenario.n_uavs
        self.commands.publish(Command(agent_instance=self.instance, action=Command.ACTION_NONE))
        if not hasattr(self, 'seen'):
            self.seen = self.create_subscription(Observation, 'observation', self.decide, LATCHED)

    def hear(self, said):
        bits = int.from_bytes(bytes(said.complete), 'little')
        self.complete[said.mission_id] |= {c for c in range(bits.bit_length()) if bits >> c & 1}

    def decide(self, seen):
        complete, (row, column) = self.complete[seen.mission_id], divmod(seen.cell, self.side)
        for index, bit in enumerate(seen.region_demand_bit):
            if bit == 0.0:  # nan outside the area
                complete.add((row + index // 3 - 1) * self.side + column + index % 3 - 1)
        said = RadioMessage(stamp=seen.stamp, mission_id=seen.mission_id, sender=self.uav)
        said.sequence, said.time_s, said.x_m, said.y_m = (
            seen.decision, seen.time_s, seen.x_m, seen.y_m)  # fmt: skip
        bits = sum(1 << cell for cell in complete)
        said.complete = bits.to_bytes((self.side**2 + 7) // 8, 'little')
        self.radio.publish(said)
        answer = Command(stamp=seen.stamp, mission_id=seen.mission_id, decision=seen.decision)
        answer.agent_instance, answer.action = self.instance, self.way(complete, seen)
        if len(seen.sensor):
            answer.action, answer.sensor = Command.HOVER, seen.sensor
            answer.bandwidth_hz = [self.hz / len(seen.sensor)] * len(seen.sensor)
        self.commands.publish(answer)

    def way(self, complete, seen):
        targets = [divmod(c, self.side) for c in range(self.side**2) if c not in complete]
        best, least = Command.RETURN_HOME, 2 * self.side
        for move, (north, east) in STEPS.items() if targets else ():
            row, column = seen.cell // self.side + north, seen.cell % self.side + east
            is_back = STEPS.get(seen.previous_action) == (-north, -east)  # not straight away
            if 0 <= row < self.side and 0 <= column < self.side and not is_back:
                far = min(abs(row - r) + abs(column - c) for r, c in targets)
                best, least = (move, far) if far < least else (best, least)
        return best


rclpy.init()
rclpy.spin(MinimalAgent(int(sys.argv[1])))
