"""Digests of mission logs that must not change: `make golden` writes them anew, for a diff."""

from collections.abc import Iterator
import csv
from dataclasses import asdict, dataclass, fields, replace
import hashlib
from pathlib import Path

from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.site import build_site
from uav_collect.uav.policy import policy_for

_FILE = Path(__file__).parents[1] / 'golden' / 'mission_logs.csv'
_WANDERERS = ('random', 'user_policies:Wanderer')  # on less energy, or they fly for hours
_WANDERERS_BUDGET_KJ = 100.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """A mission, and the log that it leaves."""

    scenario: str
    n_uavs: int
    policy: str
    bandwidth: str
    mission_seed: int
    n_events: int
    sha256: str  # of the log's bytes

    def __str__(self) -> str:
        return f'{self.scenario}-{self.n_uavs}-{self.policy}-{self.bandwidth}'


def cases() -> Iterator[Case]:
    """The missions of the file."""
    with _FILE.open(newline='') as file:
        for row in csv.DictReader(file):
            counts = {name: int(row[name]) for name in ('n_uavs', 'mission_seed', 'n_events')}
            yield Case(**(row | counts))


def digest(case: Case) -> tuple[int, str]:
    """How many events the mission has now, and the SHA-256 of its log."""
    less = {'fleet.default.energy_budget_kj': _WANDERERS_BUDGET_KJ}
    scenario = load(case.scenario, less if case.policy in _WANDERERS else None)
    scenario = with_uavs(scenario, case.n_uavs)
    policy = policy_for(case.policy, scenario)
    site, seeds = build_site(scenario), [case.mission_seed]
    [log] = fly(site, seeds, lambda: replace(policy), case.bandwidth)
    return len(log.events), hashlib.sha256(log.to_jsonl()).hexdigest()


def _rewrite() -> None:
    found = [(case, *digest(case)) for case in cases()]
    with _FILE.open('w', newline='') as file:
        names = [field.name for field in fields(Case)]
        writer = csv.DictWriter(file, names, lineterminator='\n')
        writer.writeheader()
        for case, n_events, sha256 in found:
            writer.writerow(asdict(replace(case, n_events=n_events, sha256=sha256)))


if __name__ == '__main__':
    _rewrite()
