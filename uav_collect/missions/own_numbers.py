"""A user's numbers behind those of a layout, made in Python at each decision of many missions."""

from collections.abc import Sequence
from functools import cache

from uav_collect.kernels.arrays import new_table
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.kernels.patience import say
from uav_collect.missions.batch_kernels import Batch
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.belief import belief_of
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.observation import observation_size, OwnLayout, write_own
from uav_collect.uav.user_policy import arrayed
from uav_collect.world.dynamics import look, mission_of


class OwnNumbers:
    """Writes them where kernels have written what the layout itself shows."""

    def __init__(self, layout: OwnLayout, briefing: Briefing) -> None:
        """Get ready for a fleet.

        Raises:
            ConfigError: the layout has no room for it.
        """
        self._layout, self._briefing = layout, arrayed(briefing)
        self._size = observation_size(layout, len(briefing.is_open), briefing.n_uavs)
        if kernels_are_compiled():
            _say_in_python(layout.label)

    def with_room(self, batch: Batch) -> Batch:
        """A batch whose observations are longer by these numbers."""
        table = new_table(len(batch.n_events), self._size, 0.0)
        return batch._replace(waiting=batch.waiting._replace(observation=table))

    def write(self, batch: Batch, worlds: Sequence[int]) -> None:
        """Write those of some missions, as far as they are not over.

        Raises:
            ConfigError: the user's code fails, or does not give so many finite numbers.
        """
        for world in worlds:
            uav = int(batch.waiting.uav[world])
            if uav == NONE:
                continue
            mission = mission_of(batch.missions, world)
            view = look(batch.briefing, batch.sensor_field, mission, uav, batch.view_rows)
            belief = belief_of(batch.beliefs, world * batch.briefing.n_uavs + uav)
            of = belief, view, batch.waiting.legal[world], batch.waiting.observation[world]
            write_own(self._layout, self._briefing, uav, *of)


@cache
def _say_in_python(label: str) -> None:
    say(f'observation {label}: its own numbers are made in Python at each decision')
