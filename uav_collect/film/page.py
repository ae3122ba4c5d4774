"""Puts the page of a film together: one file of HTML that asks for no other one."""

from base64 import b64encode
from functools import cache
import hashlib
import html
from importlib import resources
import json

from uav_collect.errors import in_one_line
from uav_collect.film.shown import Values
from uav_collect.limits import MAX_NAME

START, LIVE = 'start.js', 'live.js'  # what starts a film that is whole, or one that grows
_SCRIPTS = ('model.js', 'extent.js', 'map.js', 'panels.js', 'chart.js', 'player.js')
# A script in HTML ends at `</script`; the two separators end a line in older readers of JSON.
_ESCAPED = {
    '<': '\\u003c',
    '>': '\\u003e',
    '&': '\\u0026',
    '\u2028': '\\u2028',
    '\u2029': '\\u2029',
}


def film_page(footage: Values | None, connect: str = "'none'", start: str = START) -> bytes:
    """The page that shows a mission.

    Args:
        footage: as of `footage.footage`; names in it are never read as markup. None: a page that
            waits for a mission, by a script that can.
        connect: to what the page may connect, as a Content-Security-Policy says it.
        start: the script that starts all others.
    """
    script = '\n'.join(map(_part, (*_SCRIPTS, start)))
    style = _part('page.css')
    rules = (
        f"default-src 'none'; img-src data:; script-src '{_digest(script)}';"
        f" style-src '{_digest(style)}'; connect-src {connect}; base-uri 'none';"
        " form-action 'none'"
    )
    title = 'waiting for a mission'
    if footage is not None:
        named = f'{footage["scenario"]}, mission seed {footage["seed"]}'
        title = in_one_line(named, MAX_NAME)
    parts = {
        'policy': html.escape(rules),
        'title': html.escape(title),
        'style': style,
        'footage': json_in_html(footage),
        'script': script,
    }
    page = _part('page.html')
    before, *pieces = page.split('{{')
    filled = [before]
    for piece in pieces:
        name, _, rest = piece.partition('}}')
        filled += [parts[name], rest]
    return ''.join(filled).encode()


def json_in_html(values: object) -> str:
    """Values as JSON that may stand in a script element of HTML.

    Raises:
        ValueError: a number is none.
    """
    text = json.dumps(values, separators=(',', ':'), ensure_ascii=False, allow_nan=False)
    for character, escape in _ESCAPED.items():
        text = text.replace(character, escape)
    # A lone surrogate is no text of any encoding.
    return text.encode('utf-8', 'backslashreplace').decode()


@cache
def _part(name: str) -> str:
    return resources.files(__package__).joinpath('page', name).read_text(encoding='utf-8')


def _digest(text: str) -> str:
    digest = b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f'sha256-{digest}'
