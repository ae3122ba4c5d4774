"""The documents of this repository, the blocks of code in them, and the commands they show."""

from collections.abc import Iterator, Mapping
from pathlib import Path
import re
import shlex
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *(ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'CHANGELOG.md')),
    *sorted((ROOT / 'docs').rglob('*.md')),
]
MAKEFILE = (ROOT / 'Makefile').read_text()
# What make finds out by itself where nobody names it.
_FOUND = {'RUNS': 'runs/train/a_run'}


class Block(NamedTuple):
    """A block of code: where it stands, its language, its text."""

    document: Path
    language: str
    text: str


def name_of(document: Path) -> str:
    """Its path in the repository."""
    return document.relative_to(ROOT).as_posix()


def page(name: str) -> str:
    """The text of a page in docs/."""
    return (ROOT / 'docs' / name).read_text()


def blocks(text: str, language: str) -> list[str]:
    """The blocks of a language in a text."""
    return re.findall(rf'^```{language}\n(.*?)^```', text, re.MULTILINE | re.DOTALL)


def all_blocks() -> Iterator[Block]:
    """Every block of code in the documents."""
    for document in DOCUMENTS:
        for language, text in re.findall(
            r'^ *```([^\n]*)\n(.*?)^ *```$', document.read_text(), re.MULTILINE | re.DOTALL
        ):
            yield Block(document, language, text)


def command_lines() -> Iterator[list[str]]:
    """The commands that the documents show, word by word."""
    for block in all_blocks():
        if block.language == 'sh':
            for line in filter(None, block.text.replace('\\\n', ' ').splitlines()):
                if words := shlex.split(line, comments=True):
                    yield words


def targets() -> set[str]:
    """What `make help` lists."""
    return set(re.findall(r'^([\w-]+):.*##', MAKEFILE, re.MULTILINE))


def made(arguments: list[str]) -> list[list[str]]:
    """The commands of ours, with their options, that make runs with such arguments.

    Raises:
        ValueError: a target or variable is none of the Makefile's.
    """
    given = dict(word.split('=', 1) for word in arguments if '=' in word)
    named = [word for word in arguments if '=' not in word]
    known = {*re.findall(r'\$\((\w+)\)', MAKEFILE)}
    if unknown := [*({*named} - targets()), *({*given} - known)]:
        raise ValueError(f'the Makefile has no {unknown}')
    return [words for target in named for words in _run_by(target, _FOUND | given)]


def _run_by(target: str, given: Mapping[str, str]) -> Iterator[list[str]]:
    """What the recipe of a target hands to the package's main."""
    [recipe] = re.findall(rf'^{target}:.*\n((?:\t.*\n)*)', MAKEFILE, re.MULTILINE)
    for line in re.findall(r'-m uav_collect (.*)', recipe):
        yield shlex.split(_expanded(line, given))


def _expanded(text: str, given: Mapping[str, str]) -> str:
    """A text of the Makefile with its variables in place."""
    for name in re.findall(r'\$\((\w+_OPTIONS)\)', text):
        [options] = re.findall(rf'^{name} = \\\n((?:  .*\n)*)', MAKEFILE, re.MULTILINE)
        text = text.replace(f'$({name})', options.replace('\\\n', ' '))
    text = re.sub(
        r'\$\(if \$\((\w+)\),((?:[^()]|\$\(\w+\))*)\)',
        lambda found: found[2] if given.get(found[1]) else '',
        text,
    )
    return re.sub(r'\$\((\w+)\)', lambda found: given.get(found[1], ''), text)
