"""Which topics report to a learner, and of which world."""

import pytest
from uav_collect.ingest.from_messages import (
    converter_for,
    event_report,
    mission_report,
    transition_report,
)


@pytest.mark.parametrize(
    ('topic', 'expected'),
    [
        ('/world/mission', ('', mission_report)),
        ('/world/epoch', ('', event_report)),
        ('/uav_12/transition', ('', transition_report)),
        ('/north/a/world/epoch', ('/north/a', event_report)),
        ('/a/uav_1/transition', ('/a', transition_report)),
    ],
)
def test_what_reports_to_a_learner_has_a_world_and_a_converter(
    topic: str, expected: object
) -> None:
    assert converter_for(topic) == expected


@pytest.mark.parametrize(
    'topic', ['/world/markers', '/uav_1/command', '/uav_x/transition', '/world/epoch/a', '/clock']
)
def test_other_topics_report_nothing(topic: str) -> None:
    assert converter_for(topic) is None
