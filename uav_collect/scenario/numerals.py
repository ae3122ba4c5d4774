"""Numbers as people write them: decimal points and commas, groups of digits, minutes."""

from collections.abc import Iterable
import math
import re

_POINT, _COMMA = '.', ','
_PLAIN = re.compile(r'[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?', re.ASCII)
_GROUPS = {  # digits in groups of three; by the decimal mark
    _POINT: re.compile(r"[+-]?[1-9][0-9]{0,2}(?:([ ',])[0-9]{3})(?:\1[0-9]{3})*(?:\.[0-9]*)?"),
    _COMMA: re.compile(r"[+-]?[1-9][0-9]{0,2}(?:([ '.])[0-9]{3})(?:\1[0-9]{3})*(?:,[0-9]*)?"),
}
_THOUSAND_OR_FRACTION = re.compile('[+-]?[1-9][0-9]{0,2}([.,])[0-9]{3}')
_SURE = {  # by the decimal mark: it stands before a fraction, or the other one between groups
    _POINT: re.compile(
        r"[+-]?(?:(?:[0-9]*|[1-9][0-9]{0,2}(?:[ ',][0-9]{3})+)\.[0-9]+"
        r'|[1-9][0-9]{0,2}(?:,[0-9]{3}){2,})'
    ),
    _COMMA: re.compile(
        r"[+-]?(?:(?:[0-9]*|[1-9][0-9]{0,2}(?:[ '.][0-9]{3})+),[0-9]+"
        r'|[1-9][0-9]{0,2}(?:\.[0-9]{3}){2,})'
    ),
}
_SIGNS = str.maketrans(
    {'\u2212': '-', '\u2013': '-', '\u00a0': ' ', '\u202f': ' ', '\u2009': ' ', '\u2019': "'"}
)

# 46°46'52.3"N, N 46 46.872, 46d46m52s, 46:46:52
_MARKS = str.maketrans(
    {'º': '°', '˚': '°', '\u2032': "'", '\u2019': "'", '\u00b4': "'", '\u2033': '"', '\u201d': '"'}
)
_DEGREES = re.compile(
    r"""
    (?P<before>[NSEW])?\s*
    (?P<sign>[+-])?(?P<degrees>[0-9]{1,3}(?:\.[0-9]+)?)
    (?:\s*[°dD:]\s*|\s+|\s*$|(?=\s*[NSEW]$))
    (?:(?P<minutes>[0-9]{1,2}(?:\.[0-9]+)?)(?:\s*['mM:]\s*|\s+|\s*$|(?=\s*[NSEW]$)))?
    (?:(?P<seconds>[0-9]{1,2}(?:\.[0-9]+)?)(?:\s*(?:"|''|s)\s*|\s*$|(?=\s*[NSEW]$)))?
    (?P<behind>[NSEW])?
    """,
    re.VERBOSE,
)
_SAYS_DEGREES = re.compile('[°dNSEW:]')
# 2.5, <0.5, 12 %, 3 m, 1.2 Mbit
_MEASURED = re.compile(
    r"[<>\u2264\u2265~]? ?([-+0-9.,' eE]*[0-9.])"
    ' ?(?:%|°C?|[a-zµ]{1,2}|[kKMG]?(?:bit|[bB](?:ytes?)?))?'
)
# 2025-04-01, 1.4.2025 10:00, 10:00:30
_TIME = re.compile(
    r'(?:[0-9]{4}([-./])[0-9]{1,2}\1[0-9]{1,2}|[0-9]{1,2}([-./])[0-9]{1,2}\2[0-9]{4})(?:[T ,].*)?'
    '|[0-9]{1,2}:[0-9]{2}(?::[0-9]{2}.*)?'
)
_LONGEST = 100  # characters of a number


def decimal_mark(texts: Iterable[str], others: str = '') -> str:
    """The decimal mark of the numbers of a column, or of some that belong together.

    Args:
        others: that of other numbers of the table; '': nobody knows.

    Returns:
        '.' or ','; '' where 1,500 or 1.500 may be a thousand or a fraction and no other number
        tells, or they tell different things.
    """
    sure, is_open = set[str](), set[str]()
    for text in map(_cleaned, texts):
        if found := _THOUSAND_OR_FRACTION.fullmatch(text):
            is_open.add(found[1])
        else:
            sure |= {mark for mark, numbers in _SURE.items() if numbers.fullmatch(text)}
    if sure:
        return sure.pop() if len(sure) == 1 else ''
    usual = others or _POINT
    return usual if is_open <= {usual} else ''


def number_of(text: str, mark: str) -> float:
    """A number in decimal digits, by its decimal mark; nan for what is none.

    Args:
        mark: as `decimal_mark` has it; where it is '', numbers go by their own, and what may be a
            thousand or a fraction is none.
    """
    text = _cleaned(text)
    if len(text) > _LONGEST or (not mark and is_thousand_or_fraction(text)):
        return math.nan
    mark = mark or decimal_mark([text])
    grouped = _GROUPS[mark].fullmatch(text)
    if grouped:
        text = text.replace(grouped[1], '')
    if mark == _COMMA:
        text = text.replace(_COMMA, _POINT) if _POINT not in text else text
    return float(text) if _PLAIN.fullmatch(text) else math.nan


def is_measured(text: str) -> bool:
    """Whether a text is a number, with a unit or without, or a time: it names nothing."""
    found = _MEASURED.fullmatch(_cleaned(text)) if len(text) <= _LONGEST else None
    if found and not all(math.isnan(number_of(found[1], mark)) for mark in (_POINT, _COMMA)):
        return True
    return _TIME.fullmatch(text) is not None


def is_thousand_or_fraction(text: str) -> bool:
    """Whether a number may be a thousand or a fraction, if nothing else tells which."""
    return _THOUSAND_OR_FRACTION.fullmatch(_cleaned(text)) is not None


def degrees_mark(texts: Iterable[str]) -> str:
    """The decimal mark of degrees, which are no thousands: a point, or a comma if one has it."""
    return _COMMA if any(map(_has_fraction_by_comma, texts)) else _POINT


def _has_fraction_by_comma(text: str) -> bool:
    text = _cleaned(text)
    found = _THOUSAND_OR_FRACTION.fullmatch(text)
    return found[1] == _COMMA if found else _SURE[_COMMA].fullmatch(text) is not None


def degrees_of(text: str, mark: str, letters: str) -> float:
    """Degrees, with minutes and seconds or a letter of the compass, or as a number.

    Args:
        mark: as `degrees_mark` has it.
        letters: for more and for less than 0: 'NS' or 'EW'.

    Returns:
        nan where the text is no such thing, or not sure to be.
    """
    text = _cleaned(text)
    if len(text) > _LONGEST:
        return math.nan
    text = text.replace(_COMMA, _POINT) if mark == _COMMA else text
    if _PLAIN.fullmatch(text):
        return float(text)
    text = text.translate(_MARKS).strip()
    found = _DEGREES.fullmatch(text)
    if not found or not _SAYS_DEGREES.search(text):
        return math.nan
    letter = found['before'] or found['behind'] or letters[0]
    is_doubtful = (found['before'] and found['behind']) or letter not in letters
    if is_doubtful or (found['sign'] and (found['before'] or found['behind'])):
        return math.nan
    size = _size_deg(found['degrees'], found['minutes'], found['seconds'])
    is_less = letter == letters[1] or found['sign'] == '-'
    return -size if is_less else size


def _size_deg(degrees: str, minutes: str | None, seconds: str | None) -> float:
    """Degrees [deg] of parts of which only the last has a fraction; nan otherwise."""
    parts = [part for part in (degrees, minutes, seconds) if part]
    if any(_POINT in part for part in parts[:-1]):
        return math.nan
    below = [float(part) for part in parts[1:]]
    if any(part >= 60 for part in below):
        return math.nan
    return float(degrees) + sum(part / 60.0**power for power, part in enumerate(below, start=1))


def _cleaned(text: str) -> str:
    return text.strip().translate(_SIGNS)
