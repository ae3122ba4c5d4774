"""The process that chooses the policy of a mission: what it answers, and how its kernels run."""

from dataclasses import replace
import os
from pathlib import Path
import sys

from processes import completed
import pytest
from random_policies import header, saved
from tiny_world import tiny
from uav_collect.analysis.choice import Choice
from uav_collect.analysis.choosing import candidates_for, choose, planned_missions
from uav_collect.commands.choice_process import ChoiceRequest, started_choice
from uav_collect.errors import FleetError, PolicyMismatchError
from uav_collect.scenario.site import build_site

REQUEST = ChoiceRequest(
    scenario=tiny().to_yaml(), candidates='', allocator='exact', guard_after=12
)
# So many cells that few missions are flown, and a fleet that soon has to turn round.
WIDE = tiny(area__cells_per_side=40, fleet__default__energy_budget_kj=20.0)
INTERPRETED = {**os.environ, 'UAV_COLLECT_KERNELS': 'interpreted'}
ASK = f"""
import os
from uav_collect.commands.choice_process import ChoiceRequest, started_choice
if __name__ == '__main__':
    with started_choice({replace(REQUEST, scenario=WIDE.to_yaml())!r}, os.environ) as answer:
        choice, _ = answer()
    print(choice.is_compiled, choice.policy, choice.n_missions)
"""


def untimed(choice: Choice) -> Choice:
    """A choice without what it took, which is never the same."""
    return replace(choice, tried=tuple(replace(it, computing_s=None) for it in choice.tried))


def test_it_answers_what_is_chosen_in_any_process() -> None:
    with started_choice(REQUEST, INTERPRETED) as answer:
        choice, left_out = answer()
    scenario = tiny()
    candidates, unfit = candidates_for(scenario)
    here = choose(build_site(scenario), candidates, n_missions=choice.n_missions)
    there = replace(here, is_compiled=False, n_planned=choice.n_planned)
    assert untimed(there) == untimed(choice)
    assert left_out == unfit == []


def test_a_user_s_candidates_fly_too() -> None:
    request = replace(REQUEST, candidates='user_policies:homebird, random')
    with started_choice(request, INTERPRETED) as answer:
        choice, _ = answer()
    assert [it.policy for it in choice.tried] == [
        *('sweep', 'hert', 'user_policies:homebird', 'random'),
    ]


def test_what_was_refined_for_the_scenario_flies_too(tmp_path: Path) -> None:
    own = str(saved(tmp_path, 'field', header(side=4, n_uavs=2)))
    with started_choice(replace(REQUEST, own=(own,)), INTERPRETED) as answer:
        choice, _ = answer()
    assert [it.policy for it in choice.tried] == [own, 'sweep', 'hert']


def test_what_is_wrong_with_a_candidate_is_raised_here() -> None:
    request = replace(REQUEST, candidates='nope')
    with (
        pytest.raises(PolicyMismatchError, match="policy 'nope' is unknown"),
        started_choice(request, INTERPRETED) as answer,
    ):
        answer()


def test_a_process_that_dies_is_one_line() -> None:
    request = replace(REQUEST, candidates='user_policies:killed')
    with (
        pytest.raises(FleetError, match=r'chooses the policy ended with status -?\d+$'),
        started_choice(request, INTERPRETED) as answer,
    ):
        answer()


def test_without_compiled_kernels_fewer_missions_are_flown_at_once(tmp_path: Path) -> None:
    script = tmp_path / 'ask.py'
    script.write_text(ASK)
    environment = {k: v for k, v in os.environ.items() if k != 'UAV_COLLECT_KERNELS'}
    done = completed(sys.executable, script, env={**environment, 'XDG_CACHE_HOME': str(tmp_path)})
    candidates, _ = candidates_for(WIDE)
    fewer, more = (
        planned_missions(candidates, WIDE.n_cells, is_compiled=it) for it in (False, True)
    )
    assert fewer < more
    assert done.stdout == f'False sweep {fewer}\n'
    assert 'compiling' not in done.stderr
