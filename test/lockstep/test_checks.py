"""What is wrong with a message is said before anything is done with it."""

from copy import deepcopy
import math
from types import SimpleNamespace
from typing import Any

from fleets import Pilots
import pytest
from tiny_world import tiny, uav
from uav_collect.lockstep.checks import (
    join_problem,
    MOST_CHARACTERS,
    names_problem,
    observation_problem,
    radio_problem,
)
from uav_collect.uav.briefing import brief, Briefing

N_SENSORS = 1000


@pytest.fixture(scope='module')
def seen() -> tuple[Briefing, list[Any]]:
    """The observations of a mission, as messages have them, and its briefing."""
    scenario = tiny(uav(5.0), uav(10.0))
    pilots, observations = Pilots(scenario, 0, 'sweep'), []
    while (event := pilots.simulation.next_event()) is not None:
        view = deepcopy(event.view)
        n_seen = view.n_sensors
        observations.append(
            SimpleNamespace(
                uav=event.uav,
                time_s=view.time_s,
                x_m=view.x_m,
                y_m=view.y_m,
                cell=view.cell,
                energy_left_j=view.energy_left_j,
                previous_action=view.previous_action,
                region_demand_bit=list(view.region_bit),
                sensor=list(view.sensor[:n_seen]),
                sensor_demand_bit=list(view.sensor_bit[:n_seen]),
                sensor_gain=list(view.sensor_gain[:n_seen]),
                sensor_error_gain=list(view.sensor_error_gain[:n_seen]),
            )
        )
        pilots.simulation.start(event, pilots.decide(event))
    return brief(scenario), observations


def test_nothing_is_wrong_with_what_a_world_tells(seen: tuple[Briefing, list[Any]]) -> None:
    briefing, observations = seen
    assert len(observations) > 10
    assert any(each.sensor for each in observations)
    for each in observations:
        assert observation_problem(each, briefing, each.uav, N_SENSORS) is None


@pytest.mark.parametrize(
    ('field', 'value', 'problem'),
    [
        ('x_m', math.nan, 'x_m is nan: must be 0 to'),
        ('y_m', -1.0, 'y_m is -1.0: must be 0 to'),
        ('x_m', math.inf, 'x_m is inf: must be 0 to'),
        ('time_s', math.nan, 'time_s is nan: must be finite'),
        ('cell', 2**31 - 1, 'cell is 2147483647: must be the one'),
        ('energy_left_j', math.inf, 'energy_left_j is inf: must be 0 to'),
        ('previous_action', 9, 'previous_action is 9: must be -1 to 4'),
        ('region_demand_bit', [0.0] * 3, 'region_demand_bit has 3 values: must have 9'),
        ('region_demand_bit', [math.inf] * 9, r'region_demand_bit\[0\] is inf: must be'),
        ('sensor', [N_SENSORS], r'sensor\[0\] is 1000: must rise and stay below 1000'),
        ('sensor', [3, 3], r'sensor\[1\] is 3: must rise'),
        ('sensor_demand_bit', [1.0] * 99, 'sensor_demand_bit has 99 values for'),
        ('sensor_gain', [], 'sensor_gain has 0 values for'),
        ('sensor_error_gain', [math.nan] * 50, 'sensor_error_gain has 50 values for'),
    ],
)
def test_what_cannot_be_is_named(
    field: str, value: object, problem: str, seen: tuple[Briefing, list[Any]]
) -> None:
    briefing, observations = seen
    msg = deepcopy(next(each for each in observations if each.sensor))
    setattr(msg, field, value)
    with pytest.raises(ValueError, match=problem):
        raise ValueError(observation_problem(msg, briefing, msg.uav, N_SENSORS))


@pytest.mark.parametrize(
    ('field', 'value', 'problem'),
    [
        ('sender', 0, 'sender is 0: must be another UAV of 1..2'),
        ('sender', 1, 'sender is 1: must be another UAV'),
        ('sender', 200, 'sender is 200: must be another UAV'),
        ('complete', b'abc', 'complete has 3 bytes: must have'),
        ('x_m', math.nan, 'x_m is nan'),
        ('time_s', -math.inf, 'time_s is -inf'),
    ],
)
def test_a_message_that_no_radio_sends_is_named(
    field: str, value: object, problem: str, seen: tuple[Briefing, list[Any]]
) -> None:
    briefing, _ = seen
    n_bytes = (len(briefing.is_open) + 7) // 8
    msg = SimpleNamespace(sender=2, complete=bytes(n_bytes), x_m=1.0, y_m=1.0, time_s=0.0)
    assert radio_problem(msg, briefing, 0) is None
    setattr(msg, field, value)
    with pytest.raises(ValueError, match=problem):
        raise ValueError(radio_problem(msg, briefing, 0))


def test_names_are_short_and_printable() -> None:
    def problem(name: str) -> str | None:
        return names_problem(SimpleNamespace(host='here', policy=name), ('host', 'policy'))

    assert problem('sweep') is None
    assert problem('') is None
    assert problem('x' * (MOST_CHARACTERS + 1)) == (
        'policy has 201 characters: must have at most 200'
    )
    assert problem('a\x1b[2J') == "policy is 'a\\x1b[2J': must be printable"


@pytest.mark.parametrize(
    ('field', 'value', 'words'),
    [
        ('guard_after', -2, 'guard_after is -2: must be -1..10000'),
        ('guard_after', 10_001, 'guard_after is 10001: must be -1..10000'),
        ('policy', 'none', "policy is 'none': must be another name"),
        ('host', 'a\nb', 'host is '),
    ],
)
def test_a_request_to_join_is_refused_by_the_field_that_no_log_could_have(
    field: str, value: object, words: str
) -> None:
    request = SimpleNamespace(
        agent_instance='i', host='h', policy='sweep', policy_version='rule', allocator='exact',
        guard_after=-1,
    )  # fmt: skip
    assert join_problem(request) is None
    setattr(request, field, value)
    assert str(join_problem(request)).startswith(words)
