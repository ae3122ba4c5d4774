"""Flies for long while agents are killed now and then: what grows, what leaks, what is lost.

`python tools/endurance/soak.py --minutes 60` is `make soak MINUTES=60`. Of every node that lives
through it, memory and open files are sampled; after a while neither may grow by much. Where one
does, all fly as long again, and the second half of all that counts: a step, as a recorder takes
when the pace rises, is no leak.

No fleet stands still: without a kill a world grew by 460 kB in 100 missions after 400, by 340
after 600, with kills by 170 after 1,300; an idle agent grew by 400 kB beside 60 peers that were
killed one after the other. The limit leaves room for that: what leaks less than 2 kB a mission
stays unseen.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
import sys
import time

from flight import DEADLINE_S, ending, Flight, flight_of
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from uav_collect.limits import INTERRUPTED
from uav_collect.scenario.load import load, with_uavs

N_UAVS = 4
KILL_EVERY = 20  # missions
SAMPLES = 200  # of the whole time
WARM_SHARE = 0.5  # of the time, after which nothing may grow any more
WARM_MISSIONS = 800  # until then every node grows faster
GROWTH_KB = 200.0  # of a node in 100 missions
FILES = 0.1  # the same, of its open files
_SAY_EVERY_S = 60.0


@dataclass(frozen=True, kw_only=True)
class Sample:
    """What a node held at a time."""

    at_s: float
    n_missions: int
    resident_kb: float
    n_files: int


def soak(
    flight: Flight, samples: dict[str, list[Sample]], budget_s: float, console: Console
) -> None:
    """Fly for a time, twice if a node grows; add samples of the nodes that nobody kills."""
    samples |= {name: [] for name in flight.nodes if name not in flight.agents[1:]}
    console.print(f'{len(flight.nodes)} nodes are starting')
    flight.wait_until(lambda: flight.n_ended >= 1, 'the first mission')
    console.print('the first mission has ended; more is said once a minute')
    soaking = _Soaking(flight, samples, budget_s / SAMPLES, console)
    soaking.fly(budget_s)
    if grows := growing(samples):
        console.print(f'{", ".join(grows)}: still grows; flying as long again')
        soaking.fly(2.0 * budget_s)


class _Soaking:
    """A flight that is sampled, and loses agents now and then."""

    def __init__(
        self, flight: Flight, samples: dict[str, list[Sample]], every_s: float, console: Console
    ) -> None:
        self._flight, self._samples, self._every_s = flight, samples, every_s
        self._console = console
        self._begun_s = self._said_s = time.monotonic()
        self._n_killed = 0

    def fly(self, until_s: float) -> None:
        """Fly until so long after the beginning."""
        while (now_s := time.monotonic()) < self._begun_s + until_s + _more_s(self._samples):
            self._look(now_s - self._begun_s)
            self._flight.wait_until(
                lambda now_s=now_s: time.monotonic() >= now_s + 0.1, 'a moment'
            )

    def _look(self, at_s: float) -> None:
        flight, n_missions = self._flight, self._flight.n_ended
        for name, taken in self._samples.items():
            if at_s >= len(taken) * self._every_s:
                taken.append(sampled(flight, name, at_s, n_missions))
        if n_missions >= (self._n_killed + 1) * KILL_EVERY:
            flight.replace(flight.agents[1 + self._n_killed % (N_UAVS - 1)])
            self._n_killed += 1
        if at_s >= self._said_s - self._begun_s + _SAY_EVERY_S:
            self._said_s = self._begun_s + at_s
            self._console.print(f'{at_s / 60:.0f} min, {n_missions} missions', style='dim')


def growing(samples: Mapping[str, Sequence[Sample]]) -> list[str]:
    """The nodes that grow once they are warm."""
    return [
        name
        for name, (memory_kb, n_files) in ((name, slopes(it)) for name, it in samples.items())
        if memory_kb > GROWTH_KB or n_files > FILES
    ]


def _more_s(samples: Mapping[str, Sequence[Sample]]) -> float:
    """How much longer to fly at most: on a busy machine missions take their time."""
    tells = all(_tells(_n_missions(taken)) for taken in samples.values())
    return 0.0 if tells else DEADLINE_S


def _tells(n_missions: NDArray[np.float64]) -> bool:
    """Whether missions ended between samples."""
    return n_missions.size > 0 and float(np.ptp(n_missions)) > 0.0


def sampled(flight: Flight, name: str, at_s: float, n_missions: int) -> Sample:
    """What a node holds now."""
    node = flight.nodes[name]
    return Sample(
        at_s=at_s, n_missions=n_missions, resident_kb=node.resident_kb, n_files=node.n_files
    )


def slopes(taken: Sequence[Sample]) -> tuple[float, float]:
    """By how many kB and files a node grows in 100 missions, once it is warm; nan: unknown."""
    warm, n_missions = _warm(taken), _n_missions(taken)
    if not _tells(n_missions):
        return math.nan, math.nan
    held = ([each.resident_kb for each in warm], [each.n_files for each in warm])
    memory, files = (float(np.polyfit(n_missions, values, 1)[0]) * 100.0 for values in held)
    return memory, files


def _warm(taken: Sequence[Sample]) -> list[Sample]:
    """The samples that count."""
    return [each for each in taken if each.at_s >= WARM_SHARE * taken[-1].at_s]


def _n_missions(taken: Sequence[Sample]) -> NDArray[np.float64]:
    """How many missions were flown by each sample that counts, (N,)."""
    return np.array([each.n_missions for each in _warm(taken)], dtype=np.float64)


def main(argv: Sequence[str] | None = None) -> int:
    """Soak and print; the exit status is 0 if nothing grew or was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=60.0, help='how long to fly (60)')
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.minutes < 1e5:
        parser.error('minutes must be > 0 and < 100000')
    console = Console(width=None if sys.stdout.isatty() else 100)
    samples: dict[str, list[Sample]] = {}
    with flight_of(with_uavs(load('paper_8x8'), N_UAVS), pace=0.0) as flight:
        with ending(console) as end:
            soak(flight, samples, 60.0 * arguments.minutes, console)
        flight.close()
        n_missions, lost = flight.lost()
        complaints = [*end.problems, *flight.tracebacks()]
    samples = {name: taken for name, taken in samples.items() if taken}
    grows = growing(samples)
    last_s = max((taken[-1].at_s for taken in samples.values()), default=0.0)
    table = Table(title=f'{n_missions} missions in {last_s / 60:.1f} min')
    for heading in ('node', 'MB first', 'MB last', f'kB/100 missions (<= {GROWTH_KB:g})'):
        table.add_column(heading, justify='right')
    table.add_column(f'files/100 missions (<= {FILES:g})', justify='right')
    for name, taken in samples.items():
        memory_kb, n_files = slopes(taken)
        ends = (f'{each.resident_kb / 1e3:.1f}' for each in (taken[0], taken[-1]))
        table.add_row(name, *ends, f'{memory_kb:.1f}', f'{n_files:.3f}')
    console.print(table)
    for complaint in complaints:
        console.print(complaint, markup=False)
    what = f'grows: {", ".join(grows)}' if grows else 'nothing grows'
    is_early = n_missions * WARM_SHARE < WARM_MISSIONS
    verdict = 'tells too little' if is_early else 'fails' if grows else 'holds'
    if lost or complaints:
        verdict = 'fails'
    console.print(f'{verdict}: {what}; missions lost: {len(lost)} of {n_missions}')
    if is_early:
        early = f'all nodes grow faster in their first {WARM_MISSIONS} missions'
        console.print(f'{early}: soak until {WARM_MISSIONS / WARM_SHARE:.0f} are flown')
    return INTERRUPTED if end.is_interrupted else int(verdict != 'holds')


if __name__ == '__main__':
    sys.exit(main())
