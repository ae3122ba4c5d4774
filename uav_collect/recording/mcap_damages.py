"""What is damaged of an MCAP file: noted while it is read, told when all of it is known."""

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

_MOST_DAMAGES = 20  # that are named one by one


@dataclass(frozen=True, kw_only=True)
class Damage:
    """What is not as it was written, and where."""

    what: str
    chunk: int | None = None  # number from 1
    begin: int | None = None  # first byte
    end: int | None = None  # behind the last byte
    span_ns: tuple[int, int] | None = None  # log times that it held
    is_loss: bool = False  # whether messages are lost by it, as far as can be known

    def __str__(self) -> str:
        parts = []
        if self.chunk is not None:
            parts.append(f'chunk {self.chunk}')
        if self.begin is not None and self.end is not None and self.begin < self.end:
            parts.append(f'bytes {self.begin} to {self.end}')
        if self.span_ns is not None:
            first_s, last_s = (time_ns / 1e9 for time_ns in self.span_ns)
            parts.append(f'simulated time {first_s:.3f} s to {last_s:.3f} s')
        return f'{", ".join(parts)}: {self.what}' if parts else self.what


class _Note(NamedTuple):
    """A damage as it is met: which chunk it is, and what it costs, is known at the end."""

    what: str
    begin: int | None
    end: int | None
    may_cost: bool


class DamageNotes:
    """The damages of a file that is being read: the first of them, and how many follow."""

    def __init__(self) -> None:
        """Have found none yet."""
        self.n_damages = 0
        self._first: list[_Note] = []
        self._may_more_cost = False  # whether one of those that follow may
        self._ranges: list[tuple[int, int]] = []  # bytes of all of them

    def add(
        self,
        what: str,
        begin: int | None = None,
        end: int | None = None,
        *,
        may_cost: bool = False,
    ) -> None:
        """Note a damage.

        Args:
            what: the damage.
            begin: first byte, if it has a place.
            end: behind its last byte.
            may_cost: whether there may have been messages.
        """
        self.n_damages += 1
        if self.n_damages <= _MOST_DAMAGES:
            self._first.append(_Note(what, begin, end, may_cost))
        else:
            self._may_more_cost |= may_cost
        if begin is not None and end is not None:
            self._ranges.append((begin, end))

    def outside(self, places: Collection[int]) -> list[int]:
        """Those of some places, in order, that lie in the bytes of no damage."""
        ranges = sorted(self._ranges)
        begins = [begin for begin, _ in ranges]
        ends = [*accumulate((end for _, end in ranges), max, initial=0)]
        return [at for at in sorted(places) if ends[bisect_right(begins, at)] <= at]

    def damages(
        self, chunks: Collection[int], spans: Mapping[int, tuple[int, int]], *, has_all: bool
    ) -> Iterator[Damage]:
        """What was noted; of many the first, and how many more there are.

        Args:
            chunks: where chunks begin, or should.
            spans: log times of chunks by where they begin.
            has_all: whether as many messages can be read as were written.
        """
        places = sorted(chunks) if self._first else []
        for what, begin, end, may_cost in self._first:
            at = len(places) if begin is None else bisect_left(places, begin)
            span_ns = None if begin is None else spans.get(begin)
            if span_ns is not None and span_ns[0] > span_ns[1]:
                span_ns = None  # no message is in it
            yield Damage(
                what=what,
                chunk=at + 1 if at < len(places) and places[at] == begin else None,
                begin=begin,
                end=end,
                span_ns=span_ns,
                is_loss=may_cost and not has_all,
            )
        if (n_more := self.n_damages - len(self._first)) > 0:
            is_loss = self._may_more_cost and not has_all
            yield Damage(what=f'{n_more} more damages', is_loss=is_loss)
