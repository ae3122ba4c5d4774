"""The ids of all missions that were learned from, in little room, however many they are."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from operator import ge


class MissionIds:
    """A set of ids such as `world-7`, kept as the ranges of the numbers of each world.

    A world that flies one mission after the other takes two numbers, and two more for each gap.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._bounds: dict[str, list[int]] = {}  # by world: where ranges begin and end, ascending

    def __contains__(self, mission_id: str) -> bool:
        """Whether an id was added."""
        world, number = _parts(mission_id)
        return bisect_right(self._bounds.get(world, ()), number) % 2 == 1

    def __len__(self) -> int:
        """How many ids there are."""
        return sum(end - begin for begin, end in self._ranges())

    def add(self, mission_id: str) -> None:
        """Add an id.

        Raises:
            ValueError: it does not end with a number.
        """
        if mission_id in self:
            return
        world, number = _parts(mission_id)
        bounds = self._bounds.setdefault(world, [])
        for bound in (number, number + 1):  # one that is there already joins two ranges
            place = bisect_left(bounds, bound)
            if bounds[place : place + 1] == [bound]:
                del bounds[place]
            else:
                bounds.insert(place, bound)

    def state(self) -> dict[str, list[int]]:
        """All that it holds; the inverse is `restore`."""
        return {world: [*bounds] for world, bounds in self._bounds.items()}

    def restore(self, state: dict[str, list[int]]) -> None:
        """Take over the state of another one.

        Raises:
            ValueError: the numbers of a world are no ranges.
        """
        for world, bounds in state.items():
            if len(bounds) % 2 or any(map(ge, bounds, bounds[1:])):
                raise ValueError(f'the numbers of world {world!r} are no ranges')
        self._bounds.clear()
        self._bounds.update({world: [*bounds] for world, bounds in state.items()})

    def _ranges(self) -> Iterator[tuple[int, int]]:
        for bounds in self._bounds.values():
            yield from zip(bounds[::2], bounds[1::2], strict=True)


def _parts(mission_id: str) -> tuple[str, int]:
    world, _, number = mission_id.rpartition('-')
    return world, int(number)
