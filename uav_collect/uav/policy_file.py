"""A frozen policy's file: safetensors, the weights as float32, the header's fields beside them.

Its digest is the SHA-256 of the whole file with zeros where the digest stands, so that no byte
changes unnoticed. Files of version 1 have one of the weights alone: they are read, and whoever
flies them is told.
"""

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, MISSING
import hashlib
from io import BytesIO
import json
from pathlib import Path
from typing import Annotated, Any, BinaryIO, get_args, get_origin, get_type_hints

from uav_collect import files
from uav_collect.config.rules import Rule
from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.learned_on import LearnedOn, LearnedWithin
from uav_collect.uav.observation import AnyLayout
from uav_collect.uav.operating_domain import OperatingDomain
from uav_collect.uav.own_observation import layout_labelled
from uav_collect.uav.policy_header import check_shapes, PolicyHeader, Validation
from uav_collect.uav.policy_network import FrozenPolicy
from uav_collect.uav.tensor_file import parsed_json, read_head, read_tensors, tensor_file

FORMAT = 'uav_collect.policy/2'
WEIGHTS_FORMAT = 'uav_collect.policy/1'  # of before: its digest covers the weights alone
SUFFIX = '.safetensors'
_MAX_DIGITS = 19  # of a number in a header: 63 bits
_NO_DIGEST = '0' * 64

# Of a header's field.
_Records = tuple[LearnedOn | LearnedWithin | OperatingDomain, ...]
_Value = AnyLayout | Validation | _Records | int | float | str


def policy_bytes(policy: FrozenPolicy) -> bytes:
    """What a policy's file holds; the inverse is `policy_from_bytes`."""
    header = policy.header
    left_out = {
        'advice_bonus': header.layout.adviser == NONE,
        'learned_within': not header.learned_within,
        'network': not header.network,
        'code': not header.code,
        'domains': not header.domains,
    }
    texts = {
        field.name: _text(getattr(header, field.name))
        for field in fields(PolicyHeader)
        if not left_out.get(field.name, False)
    }
    content = tensor_file(policy.weights, {**texts, 'format': FORMAT, 'digest': _NO_DIGEST})
    return content.replace(_said(_NO_DIGEST), _said(hashlib.sha256(content).hexdigest()), 1)


def policy_from_bytes(content: bytes) -> FrozenPolicy:
    """The policy that a file holds.

    Raises:
        PolicyMismatchError: one line: the field, its value, what it must be.
    """
    return _read_policy(BytesIO(content), len(content))


def save_policy(path: Path, policy: FrozenPolicy) -> None:
    """Write a policy's file: whole or not at all.

    Raises:
        OSError: naming the file.
    """
    files.write_atomically(path, policy_bytes(policy))


def load_policy(path: Path) -> FrozenPolicy:
    """Read a policy's file.

    Raises:
        PolicyMismatchError: one line: the file, the field, its value, what it must be.
    """
    try:
        with files.open_file(path) as (file, size_byte):
            return _read_policy(file, size_byte)
    except OSError as error:
        raise PolicyMismatchError(f'{path}: cannot be read: {error.strerror or error}') from error
    except PolicyMismatchError as error:
        raise PolicyMismatchError(f'{path}: {error}') from error


def _read_policy(file: BinaryIO, size_byte: int) -> FrozenPolicy:
    head = read_head(file, size_byte)
    version = _field(head.texts, 'format')
    if version not in (FORMAT, WEIGHTS_FORMAT):
        wanted = f'{FORMAT!r} or {WEIGHTS_FORMAT!r}'
        raise PolicyMismatchError(f'format is {shown(version)}: must be {wanted}')
    header = _header(head.texts)
    check_shapes(header, head.shapes)
    weights, data = read_tensors(file, head)
    policy = FrozenPolicy(header, weights, is_header_covered=version == FORMAT)
    said, found = _field(head.texts, 'digest'), policy.digest
    if policy.is_header_covered:
        unsaid = head.content.replace(_said(said), _said(_NO_DIGEST), 1)
        found = hashlib.sha256(unsaid + data).hexdigest()
    if said != found:  # a text that is no digest is found nowhere in the head
        raise PolicyMismatchError(f'digest is {shown(said)}: must be {found!r}')
    return policy


def _said(digest: str) -> bytes:
    """A digest as it stands in a head; a text that quotes the like has its quotes escaped."""
    return f'"digest":"{digest}"'.encode(errors='replace')


def _text(value: _Value) -> str:
    if isinstance(value, AnyLayout):
        return value.label
    if isinstance(value, tuple):
        return json.dumps([_known(each) for each in value])
    return json.dumps(asdict(value)) if isinstance(value, Validation) else str(value)


def _known(record: LearnedOn | LearnedWithin | OperatingDomain) -> dict[str, Any]:
    """The fields of a record that say something."""
    return asdict(record, dict_factory=lambda its: {key: it for key, it in its if it is not None})


def _header(texts: Mapping[str, str]) -> PolicyHeader:
    values: dict[str, Any] = {
        field.name: _parsed(field.name, field.type, _field(texts, field.name))
        for field in fields(PolicyHeader)
        if field.default is MISSING or field.name in texts  # files of before say less
    }
    return PolicyHeader(**values)


def _parsed(name: str, kind: object, text: str) -> Any:  # noqa: ANN401 - of that kind
    if kind == AnyLayout:
        return layout_labelled(text)
    if kind is int:
        if not (text.isascii() and text.isdecimal() and len(text) <= _MAX_DIGITS):
            raise PolicyMismatchError(f'{name} is {shown(text)}: must be a whole number')
        return int(text)
    if kind is float:
        try:
            return float(text)
        except ValueError:
            raise PolicyMismatchError(f'{name} is {shown(text)}: must be a number') from None
    if kind is not str:
        return _record(name, kind, text)
    return text


def _record(name: str, kind: Any, text: str) -> Any:  # noqa: ANN401 - of that kind
    """What the JSON of a field holds."""
    of, what = kind, 'object'
    if get_origin(kind) is tuple:
        of, what = get_args(kind)[0], 'list of objects'
    try:
        return _of_kind(name, kind, parsed_json(text))
    except PolicyMismatchError:
        raise
    except ValueError as error:
        names = ', '.join(field.name for field in fields(of))
        raise PolicyMismatchError(
            f'{name} is {shown(text)}: must be a JSON {what} of {names}'
        ) from error


def _field(texts: Mapping[str, str], name: str) -> str:
    if name not in texts:
        raise PolicyMismatchError(f'{name} is missing: it is no policy of {FORMAT}')
    return texts[name]


def _of_kind(path: str, kind: Any, value: object) -> Any:  # noqa: ANN401 - of that kind
    """What JSON holds of a record, a tuple, a number or a text.

    Raises:
        ValueError: it holds something else.
        PolicyMismatchError: a number is out of range, by its path.
    """
    if isinstance(kind, type) and is_dataclass(kind):
        kinds = get_type_hints(kind, include_extras=True)
        # Files of before say less.
        wanted = {field.name for field in fields(kind) if field.default is MISSING}
        if not isinstance(value, dict) or not wanted <= value.keys() <= kinds.keys():
            raise ValueError
        return kind(
            **{name: _of_kind(f'{path}.{name}', kinds[name], it) for name, it in value.items()}
        )
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        if not isinstance(value, list):
            raise ValueError
        if parts[-1] is ...:
            parts = parts[:1] * len(value)
        pairs = enumerate(zip(parts, value, strict=True))
        return tuple(_of_kind(f'{path}.{place}', part, each) for place, (part, each) in pairs)
    if get_origin(kind) is Annotated:
        return _within(path, get_args(kind)[1], value)
    if not isinstance(value, kind):
        raise ValueError
    return value


def _within(path: str, rule: Rule, value: object) -> Any:  # noqa: ANN401 - what the rule makes
    try:
        return rule.parse(value)
    except (ValueError, OverflowError) as error:
        raise PolicyMismatchError(f'{path} is {shown(value)}: must be {rule.allowed}') from error
