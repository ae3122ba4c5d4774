"""Which code recorded something: kept beside a recording, never in a mission log."""

from collections.abc import Mapping, Sequence
import json
from pathlib import Path

from uav_collect import files
from uav_collect.kernels.compile import sources_digest
from uav_collect.revision import git_revision, package_versions

ORIGIN_FILE = 'origin.json'  # of a run folder
ORIGIN_KEY = 'origin'  # of the remarks in a bag's metadata
CHOICE_KEY = 'choice'  # the same: why its policy flies, where one was chosen
_MOST_BYTE = 1 << 20
_FLOWN_BY = ('uav_collect', 'python', 'numpy')
_POLICIES = 'policies'
_SOURCES = 'sources'  # a digest: equal ones are the same code, whatever the revision is called


def origin() -> dict[str, str]:
    """The code of this process: revision, digest of its sources, versions of what it flies by."""
    versions = package_versions()
    return {
        'revision': git_revision(),
        _SOURCES: sources_digest(),
        **{name: versions[name] for name in _FLOWN_BY if name in versions},
    }


def origin_text(policies: Mapping[str, Sequence[str]] | None = None) -> str:
    """The same as JSON.

    Args:
        policies: versions by name, of those that flew; None: they are not known.
    """
    flown = {} if policies is None else {_POLICIES: {name: [*it] for name, it in policies.items()}}
    return json.dumps({**origin(), **flown})


def parsed_origin(text: str) -> dict[str, str] | None:
    """What `origin_text` wrote; None where the text is nothing of the kind."""
    try:
        values = json.loads(text)
    except (RecursionError, ValueError):
        return None
    if not isinstance(values, dict) or _SOURCES not in values:
        return None
    return {name: value for name, value in values.items() if isinstance(value, str)}


def read_origin(folder: Path) -> dict[str, str] | None:
    """The code that wrote a run folder; None where it does not say."""
    try:
        return parsed_origin(_text_of(folder))
    except (OSError, UnicodeDecodeError):
        return None


def read_versions(folder: Path) -> dict[str, str]:
    """The versions of the policies that flew, by name, where a run folder tells a single one."""
    try:
        policies = json.loads(_text_of(folder))[_POLICIES]
        return {name: versions[0] for name, versions in policies.items() if len(versions) == 1}
    except (OSError, AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return {}


def _text_of(folder: Path) -> str:
    return files.read_bounded(folder / ORIGIN_FILE, _MOST_BYTE).decode()


def changed_since(then: Mapping[str, str]) -> str | None:
    """How the present code differs from that of a recording, in words; None if it does not."""
    now = origin()
    changed = [
        f'{name} {then[name]} then, {now[name]} now'
        for name in now
        if name in then and now[name] != then[name]
    ]
    if then[_SOURCES] == now[_SOURCES]:  # a commit that touched no source changes the revision
        changed = [text for text in changed if not text.startswith('revision ')]
    return ', '.join(changed) or None
