"""Numbers as people write them: decimal points and commas, groups of digits, minutes."""

from collections.abc import Iterable
import math
import re

_POINT, _COMMA = '.', ','
_PLAIN = re.compile(r'[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?', re.ASCII)
_GROUPS = {  # digits in groups of three; by the decimal mark
    _POINT: re.compile(r"[+-]?[0-9]{1,3}(?:([ ',])[0-9]{3})(?:\1[0-9]{3})*(?:\.[0-9]*)?"),
    _COMMA: re.compile(r"[+-]?[0-9]{1,3}(?:([ '.])[0-9]{3})(?:\1[0-9]{3})*(?:,[0-9]*)?"),
}
_FRACTION_BY_COMMA = re.compile(r"[+-]?(?:[0-9]*|[0-9]{1,3}(?:[ '.][0-9]{3})+),[0-9]+")
_FRACTION_BY_POINT = re.compile(r"[+-]?(?:[0-9]*|[0-9]{1,3}(?:[ ',][0-9]{3})+)\.[0-9]+")
_THOUSAND_OR_FRACTION = re.compile('[+-]?[1-9][0-9]{0,2}[,][0-9]{3}')
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
_LONGEST = 100  # characters of a number


def decimal_mark(texts: Iterable[str], *, is_angular: bool) -> str:
    """The decimal mark of a table's numbers: a point unless commas must be one.

    Returns:
        '.' or ','; '' where 1,500 may be a thousand or a fraction and no other number tells.
    """
    has_point = is_open = False
    for text in texts:
        text = _cleaned(text)
        if _FRACTION_BY_POINT.fullmatch(text):
            has_point = True
        elif _FRACTION_BY_COMMA.fullmatch(text):
            if is_angular or not _THOUSAND_OR_FRACTION.fullmatch(text):
                return _COMMA
            is_open = True
    return '' if is_open and not has_point else _POINT


def number_of(text: str, mark: str) -> float:
    """A number in decimal digits, by its decimal mark; nan for what is none."""
    text = _cleaned(text)
    if len(text) > _LONGEST:
        return math.nan
    grouped = _GROUPS[mark or _POINT].fullmatch(text)
    if grouped and (mark or grouped[1] != _COMMA):
        text = text.replace(grouped[1], '')
    if mark == _COMMA:
        text = text.replace(_COMMA, _POINT) if _POINT not in text else text
    return float(text) if _PLAIN.fullmatch(text) else math.nan


def degrees_of(text: str, mark: str, letters: str) -> float:
    """Degrees, with minutes and seconds or a letter of the compass, or as a number.

    Args:
        letters: for more and for less than 0: 'NS' or 'EW'.

    Returns:
        nan where the text is no such thing, or not sure to be.
    """
    number = number_of(text, mark)
    if not math.isnan(number) or len(text) > _LONGEST:
        return number
    text = _cleaned(text).translate(_MARKS).strip()
    text = text.replace(_COMMA, _POINT) if mark == _COMMA else text
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
