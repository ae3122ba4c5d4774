"""A teacher says what it would do, and has it recorded, whoever flies."""

from dataclasses import replace

import numpy as np
import pytest
from random_policies import header, random_policy
from tiny_world import tiny, uav
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.model import FaultConfig
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BY_POLICY, HOME, NONE
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import NamedPolicy, policy_named
from uav_collect.uav.policy_network import LearnedPolicy

SEEDS = [5, 6, 7]
SITE = build_site(tiny(uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)))
MOST = 40


def teacher_of(layout: Layout) -> NamedPolicy:
    return LearnedPolicy('teacher', random_policy(header(layout, 4, 2, hidden_size=8), seed=3))


TEACHERS = {
    'egocentric': teacher_of(Layout.EGOCENTRIC),
    'relative': teacher_of(Layout.RELATIVE),
    'hert': policy_named('hert'),
    'lookahead': policy_named('lookahead:hert:4'),
}


def env_of(layout: Layout, teacher: NamedPolicy | None) -> VectorEnv:
    config = VectorEnvConfig(layout=layout, reward=None, max_decisions=MOST, teacher=teacher)
    return VectorEnv(SITE, SEEDS, config)


def flown_by(env: VectorEnv, share: float, n_decisions: int = MOST) -> None:
    """Fly so many decisions, that share of them as the teacher would, the others by chance."""
    rng = np.random.default_rng(1)
    for _ in range(n_decisions):
        drawn = (env.decisions.legal * rng.uniform(0.1, 1.0, (len(SEEDS), 5))).argmax(axis=1)
        env.step(np.where((rng.uniform(size=len(SEEDS)) < share) & (env.taught != NONE),
                          env.taught, drawn))  # fmt: skip


@pytest.mark.parametrize('name', TEACHERS)
def test_who_does_what_a_teacher_says_flies_the_teachers_mission(name: str) -> None:
    teacher = TEACHERS[name]
    env = env_of(Layout.RELATIVE if name == 'relative' else Layout.EGOCENTRIC, teacher)
    flown_by(env, share=1.0)
    logs = fly(SITE, SEEDS, lambda: replace(teacher), 'equal', 0)
    for world, log in enumerate(logs):
        chosen = log.events['action'][log.events['reason'] == BY_POLICY][:MOST]
        # A rule may end a mission by itself, which who learns from it does not.
        chosen = chosen[: np.append(np.flatnonzero(chosen == HOME), MOST)[0]]
        assert len(chosen) > 5
        done = env.episode(world).records.action
        assert done[: len(chosen)].tolist() == chosen.tolist()


@pytest.mark.parametrize('name', TEACHERS)
def test_it_has_what_it_would_have_done_recorded_whoever_flies(name: str) -> None:
    # Missions that are flown again by what was done leave the same records.
    first, again = (env_of(Layout.RELATIVE, TEACHERS[name]) for _ in range(2))
    flown_by(first, share=0.5, n_decisions=15)
    said, differing = [], 0
    for world in range(len(SEEDS)):
        records = first.episode(world).records
        known = records.worth[records.is_judged == 1]
        assert (np.sort(known, axis=1) == [0, 0, 0, 0, 1]).all()
        said.append(known)
        differing += int((known.argmax(axis=1) != records.action[: len(known)]).sum())
    assert differing > 0
    again.fly_again(first.flights())
    assert again.taught.tolist() == first.taught.tolist()
    for world, known in enumerate(said):
        records = again.episode(world).records
        assert records.worth[records.is_judged == 1].tolist() == known.tolist()


@pytest.mark.parametrize('name', TEACHERS)
def test_a_mission_that_takes_off_anew_leaves_what_a_teacher_says_of_others_as_it_was(
    name: str,
) -> None:
    env, other = (env_of(Layout.RELATIVE, TEACHERS[name]) for _ in range(2))
    for each in (env, other):
        flown_by(each, share=0.5, n_decisions=6)
    before = env.taught
    env.restart(1, 99)
    assert env.taught[[0, 2]].tolist() == before[[0, 2]].tolist()
    env.step(env.taught)
    other.step(other.taught)
    assert env.taught[[0, 2]].tolist() == other.taught[[0, 2]].tolist()


def test_once_a_uav_is_lost_or_silent_the_adviser_teaches() -> None:
    for kind in ('gone', 'silent', 'slow'):
        fault = FaultConfig(uav=2, kind=kind, at_s=(12.0, 12.0))
        site = build_site(replace(SITE.scenario, faults=(fault,)))
        config = VectorEnvConfig(layout=Layout.RELATIVE, reward=None, max_decisions=MOST,
                                 teacher=TEACHERS['relative'])  # fmt: skip
        env, differing = VectorEnv(site, SEEDS, config), {True: 0, False: 0}
        for _ in range(12):
            waiting = env.decisions
            differs = (env.taught != waiting.advice) & (waiting.uav != NONE)
            for is_past in (True, False):
                differing[is_past] += int(differs[(waiting.time_s >= 12.0) == is_past].sum())
            env.step(waiting.advice)
        assert differing[False] > 0
        assert (differing[True] > 0) == (kind == 'slow')


def test_without_a_teacher_the_adviser_teaches() -> None:
    env = env_of(Layout.RELATIVE, None)
    assert env.taught.tolist() == env.decisions.advice.tolist()
    env.step(env.taught)
    assert env.episode(0).records.is_judged.sum() == 0
