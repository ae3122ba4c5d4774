"""What a training says that learned nothing."""

from types import SimpleNamespace

import pytest
from uav_collect.training.config import load_preset

pytest.importorskip('torch', reason='training needs torch')
from uav_collect.learning.loop import nothing_learned


@pytest.mark.parametrize(
    ('settings', 'takes'),
    [
        ({}, '8 missions and 100 decisions'),
        ({'rows_per_batch': 300}, '8 missions and 100 decisions, or 300 decisions of missions'),
        ({'rows_per_batch': 50}, '8 missions and 100 decisions, or 100 decisions of missions'),
        ({'decisions_before_updates': 900}, '8 missions and 900 decisions'),
        ({'sequence_decisions': 8}, '1 mission and 100 decisions'),
        ({'missions_per_batch_first': 40}, '8 missions and 100 decisions'),
        ({'missions_per_batch_first': 4}, '4 missions and 100 decisions'),
    ],
)
def test_who_learned_nothing_hears_of_each_way_to_an_update(
    settings: dict[str, int], takes: str
) -> None:
    overrides = {f'replay.{key}': value for key, value in settings.items()}
    config = load_preset(
        'strong',
        {'replay.missions_per_batch': 8, 'rollout.decisions_per_update': 100, **overrides},
    )
    said = nothing_learned(SimpleNamespace(n_decisions=7), config)
    assert said.startswith(
        'nothing was learned: 7 decisions came, too few for an update: it takes'
    )
    assert said.partition('it takes ')[2].removesuffix(' that ended') == takes
