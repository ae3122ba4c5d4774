"""The header of a policy that a training leaves: what it may fly, and how it was learned."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from uav_collect.analysis.statistics import MEASURES
from uav_collect.errors import PolicyMismatchError
from uav_collect.limits import MAX_CELLS_PER_SIDE, RELATIVE_MAX_UAVS
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.training.courses import CourseDistribution
from uav_collect.training.progress import ValidationResult
from uav_collect.uav import policy_header
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.learned_on import learned_on, LearnedOn, LearnedWithin
from uav_collect.uav.operating_domain import OperatingDomain
from uav_collect.uav.policy_header import PolicyHeader
from uav_collect.uav.policy_network import FrozenPolicy


@dataclass(frozen=True, kw_only=True)
class Learned:
    """What a policy learns on, as its header tells."""

    run: str  # begins its versions: anywhere, or paper_10x10_n2
    scenario: str
    fingerprint: str
    cells_per_side: tuple[int, int]  # least and most
    n_uavs: tuple[int, int]
    learned_on: tuple[LearnedOn, ...] = ()
    learned_within: tuple[LearnedWithin, ...] = ()
    domains: tuple[OperatingDomain, ...] = ()

    @property
    def header_fields(self) -> dict[str, Any]:
        """What of it stands in headers, by field."""
        return {
            'cells_per_side_min': self.cells_per_side[0],
            'cells_per_side_max': self.cells_per_side[1],
            'n_uavs_min': self.n_uavs[0],
            'n_uavs_max': self.n_uavs[1],
            'scenario': self.scenario,
            'fingerprint': self.fingerprint,
            'learned_on': self.learned_on,
            'learned_within': self.learned_within,
            'domains': self.domains,
        }


def learned_in_scenarios(scenarios: Sequence[Scenario]) -> Learned:
    """What a policy learns on that learns in some scenarios."""
    areas = [scenario.area for scenario in scenarios]
    sides = [side for area in areas for side in (area.n_rows, area.n_columns)]
    fleets = [scenario.n_uavs for scenario in scenarios]
    return Learned(
        run=f'{scenarios[0].name}_n{fleets[0]}',
        scenario=' '.join(dict.fromkeys(scenario.name for scenario in scenarios)),
        fingerprint=' '.join(map(fingerprint, scenarios)),
        cells_per_side=(min(sides), max(sides)),
        n_uavs=(min(fleets), max(fleets)),
        learned_on=tuple(map(learned_on, scenarios)),
    )


def learned_on_courses(distribution: CourseDistribution) -> Learned:
    """What a policy learns on that learns on drawn courses.

    One with domains may fly anything: outside of them it is its adviser who does.
    """
    domains, area, fleet = distribution.domains or (), distribution.area, distribution.fleet
    return Learned(
        run=distribution.name,
        scenario=distribution.name,
        fingerprint=distribution.fingerprint,
        cells_per_side=(1, MAX_CELLS_PER_SIDE) if domains else area.cells_per_side,
        n_uavs=(1, RELATIVE_MAX_UAVS) if domains else fleet.n_uavs,
        learned_within=(distribution.learned_within,),
        domains=domains,
    )


def header_validation(
    validation: ValidationResult | None, n_missions: int
) -> policy_header.Validation:
    """What a header says of a validation; zeros where there was none.

    Args:
        n_missions: that a validation flies.
    """
    measured = {it.key: getattr(validation, it.key, 0.0) for it in MEASURES}
    return policy_header.Validation(
        missions=n_missions if validation else 0, bandwidth='equal', **measured
    )


def network_to_start_from(initial: FrozenPolicy, briefings: Sequence[Briefing]) -> FrozenPolicy:
    """Of a policy's networks the one that decides on all fields that are learned on.

    Raises:
        PolicyMismatchError: none does, where there are several.
    """
    header = initial.header
    if header.n_networks == 1:
        return initial
    numbers = {header.network_for(briefing) for briefing in briefings}
    if len(numbers) > 1 or None in numbers:
        raise PolicyMismatchError(
            f'initial policy {header.version}: it has {header.n_networks} networks: must be one'
            ' that decides on all that is learned on'
        )
    return initial.over(briefings[0])


def check_same_network(initial: FrozenPolicy, wanted: PolicyHeader) -> None:
    """Refuse a policy to start from whose network is another one.

    Raises:
        PolicyMismatchError: what of it differs.
    """
    header = initial.header
    for name, value, known in (
        ('number of networks', header.n_networks, wanted.n_networks),
        ('observation', header.layout.label, wanted.layout.label),
        ('observation size', header.observation_size, wanted.observation_size),
        ('hidden size', header.hidden_size, wanted.hidden_size),
        ('network', header.network or 'recurrent', wanted.network or 'recurrent'),
    ):
        if value != known:
            raise PolicyMismatchError(
                f'initial policy {header.version}: its {name} is {value}: must be {known}'
            )
