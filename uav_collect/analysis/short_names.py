"""Names for tables: as short as there is room for, and never cut where they differ.

Names of policies are often paths or long words that begin alike. Of a name that is too long, parts
are left out as long as it is still told from all others: with anything at all in place of what was
left out, it could be none of them. What is left may take more than one line.
"""

from collections.abc import Iterator, Mapping, Sequence
import re

from uav_collect.errors import in_one_line
from uav_collect.limits import MAX_NAME

LEFT_OUT = '...'
_MOST_CHARACTERS = 400  # of a name that is shown whole
_PART = re.compile(r'[^/\\_.:,\s-]*[/\\_.:,\s-]*')  # up to a separator, with that


def short_names(names: Sequence[str], columns: int) -> Mapping[str, str]:
    """What to show for each of some names: within so many columns where that can be.

    A name alone is shown whole, up to the longest name that a scenario may have.
    """
    distinct = [*dict.fromkeys(names)]
    if len(distinct) == 1:
        return {distinct[0]: in_one_line(distinct[0], MAX_NAME)}
    whole = _numbered([in_one_line(name, _MOST_CHARACTERS) for name in distinct])
    return dict(zip(distinct, (_short(name, whole, columns) for name in whole), strict=True))


def _numbered(shown: Sequence[str]) -> list[str]:
    """Names with numbers, if some read alike, as they differ after hundreds of characters."""
    if len({*shown}) == len(shown):
        return [*shown]
    return [f'{number} {name}' for number, name in enumerate(shown, start=1)]


def _short(name: str, names: Sequence[str], columns: int) -> str:
    """One name without the parts that it needs least, as few of them as there is room for."""
    others, parts = [other for other in names if other != name], _PART.findall(name)[:-1]
    kept = [*parts]
    for at in _least_needed(parts, others):
        if len(_joined(kept)) <= columns:
            break
        tried = [*kept[:at], LEFT_OUT, *kept[at + 1 :]]
        if len(_joined(tried)) < len(_joined(kept)) and not _may_be_one_of(tried, others):
            kept = tried
    return _joined(kept)


def _least_needed(parts: Sequence[str], others: Sequence[str]) -> Iterator[int]:
    """The parts of a name, by index: what it begins and ends with as most alike, then the rest.

    The part before the first one that differs often says what it is: it goes late.
    """
    alike = [_PART.findall(other)[:-1] for other in others]
    n_first = max(_n_alike(parts, each) for each in alike)
    n_last = max(_n_alike(parts[::-1], each[::-1]) for each in alike)
    first = range(n_first - 1)
    last = range(len(parts) - 1, max(len(parts) - n_last, n_first) - 1, -1)
    yield from first
    yield from last
    yield from (at for at in range(len(parts)) if at not in first and at not in last)


def _n_alike(parts: Sequence[str], others: Sequence[str]) -> int:
    """How many parts two names begin with alike."""
    pairs = zip(parts, others, strict=False)
    return next((at for at, (one, two) in enumerate(pairs) if one != two), 0)


def _may_be_one_of(parts: Sequence[str], others: Sequence[str]) -> bool:
    """Whether what is left of a name fits another one, with anything where parts were left out."""
    begin, *middle = _joined(parts).split(LEFT_OUT)
    return any(_fits(begin, middle, other) for other in others)


def _fits(begin: str, others: Sequence[str], name: str) -> bool:
    """Whether a name begins with a text and holds others after it, each after the one before.

    The last of them must be its end.
    """
    if not name.startswith(begin):
        return False
    at = len(begin)
    for text in others[:-1]:
        found = name.find(text, at)
        if found < 0:
            return False
        at = found + len(text)
    return name.endswith(others[-1]) and len(name) - len(others[-1]) >= at


def _joined(parts: Sequence[str]) -> str:
    """The parts in a line, with one sign for all that was left out between two of them."""
    kept: list[str] = []
    for part in parts:
        if part != LEFT_OUT or kept[-1:] != [part]:
            kept.append(part)
    return ''.join(kept)
