"""Where links of pages lead on the site, and what comes along for them."""

from collections.abc import Iterator
import os
from pathlib import Path
import posixpath
import re
from typing import Any

ROOT = Path(__file__).parents[2]
# Pages of the site, by the files at the root of the repository that they are.
PAGES = {
    'README.md': 'index.md',
    'CONTRIBUTING.md': 'contributing/guide.md',
    'CHANGELOG.md': 'contributing/changelog.md',
}
_HOMES = {page: source for source, page in PAGES.items()}
_LINK = re.compile(r'(!?\[[^\]]*\])\(([^)\s#]*)(#[^)\s]*)?\)')
_BLOCK = re.compile(r'^ *```.*?^ *```$', re.MULTILINE | re.DOTALL)
_LOADED = re.compile(r'<(?:script|img|iframe|link)\b[^>]* (?:src|href)="((?:https?:)?//[^"]+)"')


def sources_linked(markdown: str, page: str) -> Iterator[str]:
    """The files of the repository, no pages, that a page of the site links."""
    for _, target, _ in _LINK.findall(_BLOCK.sub('', markdown)):
        path = _path_of(page, target)
        if path and not path.startswith('docs/') and path not in PAGES and (ROOT / path).is_file():
            yield path


def led(markdown: str, page: str) -> str:
    """A page whose links lead to pages of the site, or to sources that came along.

    Args:
        markdown: its text, in which links lead to files of the repository.
        page: its path on the site, as `how_to/nodes.md`.
    """
    parts, done = [], 0
    for block in _BLOCK.finditer(markdown):  # code keeps its brackets
        parts += [_led(markdown[done : block.start()], page), block[0]]
        done = block.end()
    return ''.join([*parts, _led(markdown[done:], page)])


def loaded_from_elsewhere(html: str) -> list[str]:
    """The addresses that a page asks the network for as it is shown."""
    return _LOADED.findall(html)


def left_out(nav: Any) -> list[str]:  # noqa: ANN401 - as YAML has it
    """The pages of docs/ that a navigation does not name, by their paths there.

    Args:
        nav: of mkdocs.yml: paths, titles with paths, titles with more of the same.
    """
    pages = {path.relative_to(ROOT / 'docs').as_posix() for path in (ROOT / 'docs').rglob('*.md')}
    return sorted(pages - {*_named(nav)})


def _named(nav: Any) -> Iterator[str]:  # noqa: ANN401
    match nav:
        case str():
            yield nav
        case list() | dict():
            for part in nav.values() if isinstance(nav, dict) else nav:
                yield from _named(part)


def _path_of(page: str, target: str) -> str:
    """The path in the repository that a page's link leads to; '' if it leads out of that."""
    if not target or ':' in target:
        return ''
    home = _HOMES.get(page, f'docs/{page}')
    return posixpath.normpath(posixpath.join(posixpath.dirname(home), target))


def _led(text: str, page: str) -> str:
    def lead(found: re.Match[str]) -> str:
        label, target, anchor = found[1], found[2], found[3] or ''
        path = _path_of(page, target)
        if path in PAGES:
            goal = PAGES[path]
        elif path.startswith('docs/'):
            goal = path.removeprefix('docs/')
        elif path and (ROOT / path).is_file():
            goal = f'source/{path}.txt'
        elif path and (ROOT / path).is_dir():
            return f'`{path}`'  # a folder has no page
        else:
            return found[0]
        return f'{label}({os.path.relpath(goal, Path(page).parent)}{anchor})'

    return _LINK.sub(lead, text)
