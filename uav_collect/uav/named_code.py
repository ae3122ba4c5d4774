"""Finds the code that users name as `module:name`: a policy, a mixer, a reward, ..."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
import hashlib
import importlib
from inspect import getattr_static
import os
from pathlib import Path
import sys
from types import ModuleType
from typing import Any

from uav_collect.uav.user_code import kind_text, name_text, run_user_code, UserCodeError

# Code that a published policy may name, with commas between: importing a module runs it.
TRUSTED_VARIABLE = 'UAV_COLLECT_TRUSTED_CODE'
_VERSION_DIGITS = 12
_is_published = ContextVar('is_published', default=False)


@dataclass(frozen=True, kw_only=True)
class NamedCode:
    """A function or class of a user."""

    name: str  # module:name
    target: Callable[..., Any]
    version: str  # of its file
    file: str | None  # in which it was written

    @property
    def label(self) -> str:
        """Name and version, as records keep them."""
        return f'{self.name}@{self.version}'

    def call(self, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
        """What a function of it returns.

        Raises:
            UserCodeError: it raised anything at all; in one line, with file and line of it.
        """
        return run_user_code(self.file, function, *arguments)


def named_code(name: str, members: Sequence[str] = ()) -> NamedCode:
    """The code `module:name`; the module may lie in the working directory.

    Args:
        members: what it must have, such as methods.

    Raises:
        UserCodeError: there is no such module or name, the module fails, a member is missing, or a
            published policy names what is not trusted.
    """
    if _is_published.get() and name not in os.environ.get(TRUSTED_VARIABLE, '').split(','):
        raise UserCodeError(
            f'{name} is named by a published policy: its module is only imported where '
            f'{TRUSTED_VARIABLE} lists it'
        )
    module_name, _, target_name = name.partition(':')
    module = _imported(module_name)
    target = getattr_static(module, target_name, None)
    if target is None:
        raise UserCodeError(f'module {module_name} has no {target_name}')
    if not callable(target):
        wanted = 'a class' if members else 'a function'
        raise UserCodeError(f'{target_name} is a {kind_text(target)}: must be {wanted}')
    lacking = [it for it in members if not hasattr(target, it)]
    if lacking:
        raise UserCodeError(
            f'{target_name} lacks {" and ".join(lacking)}: must have {", ".join(members)}'
        )
    file = _file_of(module)
    return NamedCode(name=name, target=target, version=_version(file), file=file)


def trust(names: Sequence[str]) -> None:
    """Let this process, and those that it starts, import code that published policies name."""
    known = filter(None, os.environ.get(TRUSTED_VARIABLE, '').split(','))
    os.environ[TRUSTED_VARIABLE] = ','.join(dict.fromkeys((*known, *names)))


@contextmanager
def of_published() -> Iterator[None]:
    """While something is read that anybody may have published: only trusted code is imported."""
    token = _is_published.set(True)
    try:
        yield
    finally:
        _is_published.reset(token)


def code_of(target: Callable[..., Any]) -> NamedCode:
    """A function or class that is at hand, as if it had been named."""
    module = getattr_static(target, '__module__', None)
    file = _file_of(sys.modules.get(module) if isinstance(module, str) else None)
    return NamedCode(name=name_text(target), target=target, version=_version(file), file=file)


def _file_of(module: ModuleType | None) -> str | None:
    file = vars(module).get('__file__') if isinstance(module, ModuleType) else None
    return file if isinstance(file, str) else None


def _imported(module: str) -> ModuleType:
    # An installed command, unlike "python -m", does not look where the user is.
    if not {'', os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    try:
        found = run_user_code(None, importlib.import_module, module)
    except UserCodeError as failure:
        error = failure.__cause__
        name = error.name if isinstance(error, ModuleNotFoundError) else None
        if name is not None and f'{module}.'.startswith(f'{name}.'):
            raise UserCodeError(
                f'there is no module {name} in {os.getcwd()} or where else Python looks'
                ' (PYTHONPATH)'
            ) from None
        raise UserCodeError(f'module {module} cannot be imported: {failure}') from failure
    if not isinstance(found, ModuleType):
        raise UserCodeError(f'module {module} is a {kind_text(found)}: must be a module')
    return found


def _version(file: str | None) -> str:
    """A digest of a module's file, so that results tell which one was flown."""
    try:
        content = Path(file or '').read_bytes()
    except (OSError, ValueError):  # it has none, or lies in an archive
        return 'built-in'
    return hashlib.sha256(content).hexdigest()[:_VERSION_DIGITS]
