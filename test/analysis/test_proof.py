"""What is proved of a bag: every field of every message follows from the mission."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from recordings import end_of, flown_with_injected, messages_of, start_of, Values, write_bag
from uav_collect.analysis.proof import bag_account, log_account, Proof, Verdict
from uav_collect.analysis.proof import prove as prove_accounts
from uav_collect.analysis.recording_proof import Given, prove_recording
from uav_collect.missions.recorded_policies import RecordedPolicies
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.recording.mission_messages import MessagePlace, MissionMessages
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site, Site
from uav_collect.world.sensor_field import demand_of

SEED = 4
ID = 'world-0'
Said = dict[MessagePlace, Values]


@pytest.fixture(scope='module')
def site() -> Site:
    return build_site(load('paper_8x8', {'fleet.default.energy_budget_kj': 8.0}))


@pytest.fixture(scope='module')
def log(site: Site) -> MissionLog:
    return fly(site, [SEED], 'sweep')[0]


@pytest.fixture(scope='module')
def said(site: Site, log: MissionLog) -> Said:
    return messages_of(site, log)


@pytest.fixture
def prove(
    site: Site, log: MissionLog, said: Said
) -> Callable[[Callable[[list[Values], Said], None]], Proof]:
    """Proves what a bag of the mission would hold after a change of its messages."""

    def proof_after(change: Callable[[list[Values], Said], None]) -> Proof:
        phases, changed = phases_of(site, log), deepcopy(said)
        change(phases, changed)
        mission = MissionMessages(
            mission_id=ID,
            phases={values['phase']: as_message(values) for values in phases},
            placed={place: [as_message(values)] for place, values in changed.items()},
        )
        return prove_accounts('m', [bag_account('bag', mission)], site, RecordedPolicies(), None)

    return proof_after


def phases_of(site: Site, log: MissionLog) -> list[Values]:
    demand_bit = demand_of(site, SEED).tolist()
    return [start_of(site, log, demand_bit), end_of(site, log, demand_bit)]


def as_message(values: Values) -> SimpleNamespace:
    uavs = [SimpleNamespace(**uav) for uav in values.get('uavs', [])]
    sec, nanosec = divmod(round(values.get('time_s', 0.0) * 1e9), 1_000_000_000)
    named = {'policy_trainer': '', 'stamp': SimpleNamespace(sec=sec, nanosec=nanosec)}
    return SimpleNamespace(**{**named, **values, 'uavs': uavs})


Prove = Callable[[Callable[[list[Values], Said], None]], Proof]


def test_a_whole_bag_is_proved(site: Site, log: MissionLog, said: Said, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / 'bag', site, {ID: (phases_of(site, log), said)})
    [proof] = prove_recording(bag, Given())
    assert str(proof) == f'bag: mission {ID}, seed {SEED}: proved, {len(log.events)} events'


def test_files_beside_a_bag_that_cannot_be_read_do_not_end_the_others(
    site: Site, log: MissionLog, said: Said, tmp_path: Path
) -> None:
    write_bag(tmp_path / 'bag', site, {ID: (phases_of(site, log), said)})
    for name in (f'mission_{SEED}.jsonl', 'scenario.yaml'):
        with (tmp_path / name).open('wb') as file:
            file.truncate(1 << 30)
    (tmp_path / 'other.jsonl').write_bytes(log.to_jsonl())
    mission, scenario, alone = prove_recording(tmp_path, Given(site=site))
    log_name = f'mission_{SEED}.jsonl'
    for proof, what in ((mission, f'{log_name} cannot be read'), (scenario, 'cannot be read')):
        assert proof.verdict is Verdict.UNPROVABLE
        assert proof.findings[0].startswith(f'{what}: has 1,073,741,824 bytes')
    assert alone.verdict is Verdict.PROVED


def other(value: Any) -> Any:  # noqa: ANN401 - of any field
    """Another value of the same kind, as near as can be."""
    if isinstance(value, list):
        at = next(i for i, each in enumerate(value) if each == each)  # not nan
        return [*value[:at], other(value[at]), *value[at + 1 :]]
    if isinstance(value, str):
        return f'{value}x'
    if isinstance(value, bool):
        return not value
    return value + (1 if isinstance(value, int) else max(1e-9, abs(value) * 1e-9))


def first_of(said: Said, kind: str, field: str) -> MessagePlace:
    """The first message of a kind whose field is not empty."""
    return min(place for place in said if place.kind == kind and said[place].get(field) != [])


FIELDS = {
    'epoch': (
        *('time_s', 'x_m', 'duration_s', 'energy_left_j', 'energy_j', 'collected_bit', 'reward'),
        *('n_sensors', 'known_complete', 'interval_s', 'uav', 'heard', 'policy_version'),
        *('uav_x_m', 'uav_y_m', 'uav_energy_left_j', 'uav_phase', 'uav_complete', 'terminal'),
        *('true_complete', 'action', 'reason'),
    ),
    'observation': (
        *('event', 'time_s', 'x_m', 'y_m', 'cell', 'energy_left_j', 'region_demand_bit'),
        *('sensor', 'sensor_demand_bit', 'sensor_gain', 'sensor_error_gain', 'previous_action'),
        *('n_radio_delivered', 'exploration_key', 'terminated'),
    ),
    'command': ('action', 'reason', 'sensor', 'bandwidth_hz', 'policy_version'),
    'radio_tx': ('sender', 'time_s', 'x_m', 'y_m', 'complete'),
    'radio_rx': ('sender', 'time_s', 'x_m', 'y_m', 'complete'),
    'transition': (
        *('uav', 'event', 'scenario_fingerprint', 'policy_version', 'observation', 'legal'),
        *('action', 'time_s', 'energy_left_j', 'cell', 'previous_action', 'complete', 'seen'),
        *('peer_x_m', 'peer_y_m', 'peer_s'),
    ),
}


@pytest.mark.parametrize(
    ('kind', 'field'), [(kind, field) for kind, fields in FIELDS.items() for field in fields]
)
def test_a_field_with_another_value_is_named(
    kind: str, field: str, prove: Prove, said: Said
) -> None:
    place = first_of(said, kind, field)

    def change(phases: list[Values], said: Said) -> None:
        said[place][field] = other(said[place][field])

    proof = prove(change)
    assert proof.verdict is Verdict.DIFFERS
    name = f'event {place.number}' if kind == 'epoch' else f'{kind} {place.number} of UAV 1'
    assert any(f'{name}: ' in each and field in each for each in proof.findings) or (
        field == 'policy_version'  # then it is the policy that has changed
    )


@pytest.mark.parametrize(
    ('phase', 'field'),
    [
        *((0, name) for name in ('total_bit', 'scenario_fingerprint', 'demand_bit', 'seed')),
        *((1, name) for name in ('collected_bit', 'completion_s', 'energy_j', 'n_decisions')),
        (1, 'efficiency_bit_per_j'),
    ],
)
def test_figures_that_do_not_follow_are_named(phase: int, field: str, prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        value = phases[phase][field]
        phases[phase][field] = value * 1.001 if field == 'demand_bit' else other(value)

    proof = prove(change)
    word = ('start', 'end')[phase]
    assert any(f'message about its {word}: {field} is ' in each for each in proof.findings)


@pytest.mark.parametrize('field', ['hover_s', 'outcome'])
def test_what_is_said_of_a_uav_in_the_end_follows_too(field: str, prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        phases[1]['uavs'][1][field] += 1

    assert any(f'end: UAV 2: {field} is ' in each for each in prove(change).findings)


@pytest.mark.parametrize('kind', ['epoch', 'observation', 'command', 'radio_tx', 'radio_rx'])
def test_messages_that_are_missing_are_named(kind: str, prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        for place in [each for each in said if each.kind == kind and each.number in (2, 3)]:
            del said[place]

    proof = prove(change)
    assert proof.verdict is Verdict.DIFFERS
    assert any('more: not recorded' in finding for finding in proof.findings)
    if kind != 'epoch':  # where nothing is otherwise, nothing was changed
        assert all(finding.endswith('not recorded') for finding in proof.findings)


def test_a_message_too_many_is_named(prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        said[MessagePlace('radio_rx', 1, 999)] = said[MessagePlace('radio_rx', 1, 1)] | {
            'delivery': 999
        }

    [finding, *_] = prove(change).findings
    assert finding == 'radio_rx 999 of UAV 1: there is none such in the mission'


def test_a_command_that_the_world_did_not_wait_for_is_passed_over(prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        said[MessagePlace('command', 1, 900)] = said[MessagePlace('command', 1, 1)] | {
            'decision': 900
        }

    assert prove(change).verdict is Verdict.PROVED


def test_faults_that_only_the_second_account_tells_of_were_injected_too(site: Site) -> None:
    log = flown_with_injected(site, 'sweep', 6, ('slow', 0), ('silent', 1), seed=SEED)
    content = log.to_jsonl()
    cut_off = content[: content.index(b'{"event": 5')]
    accounts = [log_account('cut', cut_off), log_account('whole', content)]
    proof = prove_accounts('m', accounts, site, RecordedPolicies(), None)
    assert proof.n_injected == 2
    n_events = len(log.events)
    assert proof.findings[0] == f'cut: event 5: not recorded, flown {n_events} events'


def test_a_recording_cut_off_in_flight_is_proved_as_far_as_it_goes(prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        del phases[1]
        for place in [each for each in said if each.kind == 'epoch' and each.number > 5]:
            del said[place]

    assert str(prove(change)).endswith('proved, 6 events, cut off before its end')


def test_a_bag_of_events_alone_is_proved(prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        for place in [each for each in said if each.kind != 'epoch']:
            del said[place]

    assert prove(change).verdict is Verdict.PROVED


def test_another_version_of_the_policy_is_named(prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        for values in said.values():
            if 'policy_version' in values:
                values['policy_version'] = 'older'

    proof = prove(change)
    assert proof.findings == (
        'flown to the same bytes',
        'policy sweep is of version rule now, of older then',
    )


def test_a_uav_that_two_versions_have_flown_is_named(prove: Prove) -> None:
    def change(phases: list[Values], said: Said) -> None:
        for place, values in said.items():
            if place.kind == 'epoch' and place.number > 5 and values['uav'] == 1:
                values['policy_version'] = 'younger'

    assert 'UAV 1 was flown by rule, then younger' in prove(change).findings


def test_what_a_recording_says_does_not_steer_the_terminal() -> None:
    proof = Proof(mission='\x1b[31m', verdict=Verdict.DIFFERS, findings=('a\x1f\nb', 'c' * 5_000))
    assert str(proof).isprintable()
    assert len(str(proof)) < 1_000


def test_a_line_about_a_bag_names_its_first_damages_and_counts_the_others() -> None:
    damages = tuple(f'chunk {number}' for number in range(1, 31))
    proof = Proof(mission='bag', verdict=Verdict.DAMAGED, findings=damages)
    assert str(proof).startswith('bag: damaged: chunk 1; chunk 2; ')
    assert str(proof).endswith('; chunk 8; 22 more')
