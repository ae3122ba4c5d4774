"""What numba must know of a `Handle`: it is the address of rows as kernels hold them."""

import hashlib
from typing import Any

import numba
from numba.core import cgutils, types
from numba.core.imputils import lower_getattr
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, models, NativeValue, register_model, unbox
import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.compile import kernel

_FIRST_ROOM_BYTE = 1 << 14
_types: dict[int, 'HandleType'] = {}  # numba takes milliseconds to find the type of rows


class HandleType(types.Type):
    """The type of a handle, by that of its rows."""

    def __init__(self, rows: Any) -> None:  # noqa: ANN401 - a type of numba's
        """Name it by them."""
        self.rows = rows
        super().__init__(name=f'Handle({rows})')


def taken_out_of(rows: tuple[object, ...]) -> tuple[NDArray[np.uint8], HandleType]:
    """Rows as kernels hold them, arrays by their addresses; and the type of a handle to them."""
    taken_out = np.empty(_FIRST_ROOM_BYTE, np.uint8)
    n_bytes, kind = put_into(taken_out, rows)
    if n_bytes > len(taken_out):
        taken_out = np.empty(n_bytes, np.uint8)
        put_into(taken_out, rows)
    if kind not in _types:
        _types[kind] = HandleType(numba.typeof(rows))
    return taken_out, _types[kind]


@kernel
def put_into(taken_out: NDArray[np.uint8], rows: tuple[object, ...]) -> tuple[int, int]:
    """Write rows as kernels hold them; nothing, where room is short.

    Returns:
        The room that they take [byte], and a number that no rows of other types have.
    """
    both: tuple[int, int] = _put_into(taken_out, rows)
    return both


@register_model(HandleType)
class _Address(models.OpaqueModel):  # type: ignore[misc]
    """A handle is passed as an address."""


@unbox(HandleType)  # type: ignore[untyped-decorator]
def _address(typ: HandleType, handle: Any, c: Any) -> NativeValue:  # noqa: ANN401
    number = c.pyapi.object_getattr_string(handle, 'address')
    address = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(address, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    """A handle has nothing but its rows."""

    key = HandleType

    def resolve_rows(self, handle: HandleType) -> Any:  # noqa: ANN401
        """Their type."""
        return handle.rows


@lower_getattr(HandleType, 'rows')  # type: ignore[untyped-decorator]
def _rows(context: Any, builder: Any, typ: HandleType, address: Any) -> Any:  # noqa: ANN401
    kind = context.get_value_type(typ.rows).as_pointer()
    return _loaded(context, builder, typ.rows, builder.bitcast(address, kind))


@intrinsic  # type: ignore[untyped-decorator]
def _put_into(typingctx: Any, taken_out: Any, rows: Any) -> Any:  # noqa: ANN401
    def put(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        room = context.make_array(taken_out)(context, builder, arguments[0])
        kind = context.get_value_type(rows)
        n_bytes = context.get_constant(types.intp, context.get_abi_sizeof(kind))
        number = context.get_constant(types.intp, int(digest[:15], 16))
        with builder.if_then(builder.icmp_signed('>=', room.nitems, n_bytes)):
            address = builder.bitcast(room.data, kind.as_pointer())
            _store(builder, rows, arguments[1], address)
        return context.make_tuple(builder, signature.return_type, [n_bytes, number])

    digest = hashlib.sha256(str(rows).encode()).hexdigest()
    return types.containers.UniTuple(types.intp, 2)(taken_out, rows), put


# LLVM takes minutes for a thousand numbers that are read or written as one.


def _store(builder: Any, typ: Any, value: Any, address: Any) -> None:  # noqa: ANN401
    if not isinstance(typ, types.containers.BaseTuple):
        builder.store(value, address)
        return
    for index, part in enumerate(typ):
        of_part = cgutils.gep_inbounds(builder, address, 0, index)
        _store(builder, part, builder.extract_value(value, index), of_part)


def _loaded(context: Any, builder: Any, typ: Any, address: Any) -> Any:  # noqa: ANN401
    if not isinstance(typ, types.containers.BaseTuple):
        return builder.load(address)
    parts = [
        _loaded(context, builder, part, cgutils.gep_inbounds(builder, address, 0, index))
        for index, part in enumerate(typ)
    ]
    return context.make_tuple(builder, typ, parts)
