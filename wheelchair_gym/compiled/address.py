"""Arrays by address: how a record points to the arrays that belong to it.

A compiled function takes a record of addresses in a microsecond, a tuple of arrays in ten; and a
row of a batch can point to arrays whose lengths differ from row to row. `Pointers` is the only way
to write an address into a record: it checks the array, keeps it alive, and writes the address anew
in every copy of the record. Arrays that come from outside pass `as_array` first.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
from numba.np.numpy_support import from_dtype
from numpy.typing import DTypeLike, NDArray

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.kernel import inlined

Shape = tuple[int | None, ...]  # None: any length


def as_array(
    value: Any, dtype: DTypeLike, shape: Shape, where: str, maximum: float | None = None
) -> NDArray[Any]:
    """A C-contiguous, aligned array of a dtype and shape; the one given where it is such an array.

    Args:
        value: array or nested sequences of numbers.
        dtype: wanted; numbers are converted where they fit, other types are refused.
        shape: wanted; None is any length.
        where: how errors call it.
        maximum: values are finite and no larger than this; None: any value.

    Raises:
        InputError: the type, the shape or a value is wrong.
    """
    wanted = np.dtype(dtype)
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"{where} is not an array of numbers") from None
    fits = array.dtype == wanted if wanted.kind == "V" else array.dtype.kind in "iuf"
    if not fits:
        raise InputError(f"{where} has dtype {array.dtype}; expected {_named(wanted)}")
    if not _has(array, shape):
        expected = ", ".join("n" if length is None else str(length) for length in shape)
        comma = "," if len(shape) == 1 else ""
        raise InputError(f"{where} has shape {array.shape}; expected ({expected}{comma})")
    if maximum is not None:
        wrong = ~((array <= maximum) & (array >= -maximum))
        if wrong.any():
            place = tuple(int(k) for k in np.argwhere(wrong)[0])
            raise InputError(
                f"{where}{list(place)} is {array[place]:g}; expected at most {maximum:g} in size"
            )
    if wanted.kind in "iu" and array.dtype != wanted:
        bounds = np.iinfo(wanted)
        wrong = ~((array >= bounds.min) & (array <= bounds.max) & (array == np.rint(array)))
        if wrong.any():
            raise InputError(f"{where} has a value of {array[wrong][0]}; expected {wanted}")
    return np.require(array, wanted, ["C", "A"])


def _has(array: NDArray[Any], shape: Shape) -> bool:
    lengths = zip(array.shape, shape, strict=False)
    return array.ndim == len(shape) and all(want in (None, have) for have, want in lengths)


def _named(dtype: np.dtype[Any]) -> str:
    return "a record of its own kind" if dtype.kind == "V" else str(dtype)


class Target:
    """Type of the arrays that an address in a record points to: dtype and shape."""

    def __init__(self, dtype: DTypeLike, *shape: int | None) -> None:
        self.dtype, self.shape = np.dtype(dtype), shape


def read_record(name: str, names: Mapping[str, Any]) -> tuple[np.dtype[Any], dict[str, Target]]:
    """Read a record from the TOML file beside a module: its dtype, and what addresses point to.

    A field is a type and a shape: "f8", "f8[3]", "TRACK[TRACKS]". With "&" it is the address of
    such an array, of any length along ":". A field "*" stands for all fields of its type.

    Args:
        name: of the record.
        names: the module's globals: they hold the types and lengths that the file names.
    """
    file = Path(names["__file__"]).with_suffix(".toml")
    fields, targets = list[tuple[Any, ...]](), dict[str, Target]()
    for field, text in tomllib.loads(file.read_text("utf-8"))[name].items():
        kind, *lengths = re.findall(r"\w+|:", text)
        kind, sides = names.get(kind, kind), (names.get(length, length) for length in lengths)
        shape = tuple(None if side == ":" else int(side) for side in sides)
        if field == "*":
            fields += kind.descr
        elif "&" in text:
            fields.append((field, "u8"))
            targets[field] = Target(kind, *shape)
        else:
            fields.append((field, kind, shape))
    return np.dtype(fields, align=True), targets


class Pointers:
    """A record array whose fields hold addresses, and the arrays that these are of.

    A copy, by `copy` or `pickle`, points to the copies of the arrays.

    Args:
        record: (n,) whose address fields are written here and nowhere else.
        targets: what each of these fields points to, by its name.
        constant: nothing is written any more once this was handed on: a deep copy is itself.
    """

    def __init__(
        self, record: NDArray[np.void], targets: Mapping[str, Target], constant: bool = False
    ) -> None:
        self.record = record
        self._targets, self._constant = targets, constant
        self._kept: dict[tuple[int, str], NDArray[Any] | Pointers] = {}

    def point(self, name: str, to: NDArray[Any] | Pointers, row: int = 0) -> None:
        """Point a field of a row to an array, which is kept alive.

        Args:
            name: of the field.
            to: an array of numbers, or the pointers whose record it is: addresses in a record that
                was copied apart from its pointers would be those of the original.
            row: of the record.

        Raises:
            ValueError: the array is not what the field points to, or not contiguous.
        """
        target, array = self._targets[name], _array_of(to)
        if array.dtype != target.dtype or not _has(array, target.shape):
            raise ValueError(
                f"{name}: an array {array.shape} of {_named(array.dtype)}; expected "
                f"{target.shape} of {_named(target.dtype)}"
            )
        self.record[name][row] = address_of(array)
        self._kept[row, name] = to

    def fill(self, row: int = 0, /, **values: Any) -> Pointers:
        """Set fields of a row by name: values, or arrays and `Pointers` by address; see `point`.

        Returns:
            These pointers.
        """
        for name, value in values.items():
            if name in self._targets:
                self.point(name, value, row)
            else:
                self.record[name][row] = value
        return self

    def array(self, name: str, row: int = 0) -> NDArray[Any]:
        """Return the array that a field of a row points to; an empty array if there is none yet."""
        to = self._kept.get((row, name))
        if to is None:
            target = self._targets[name]
            return np.zeros([length or 0 for length in target.shape], target.dtype)
        return _array_of(to)

    @property
    def address(self) -> int:
        """The address of the record: a kernel takes a number faster than an array."""
        return address_of(self.record)

    def again(self) -> Pointers:
        """The same addresses in another record."""
        other = Pointers(self.record.copy(), self._targets, self._constant)
        other._kept.update(self._kept)
        return other

    def __deepcopy__(self, memo: dict[int, Any]) -> Pointers:
        if self._constant:
            return self
        other = Pointers.__new__(Pointers)
        memo[id(self)] = other
        record, kept = copy.deepcopy((self.record, self._kept), memo)
        state = {"_targets": self._targets, "_constant": False, "record": record, "_kept": kept}
        other.__setstate__(state)
        return other

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take up the state of another; the arrays are copies, or were read from a file."""
        self.__dict__.update(state)
        for (row, name), to in self._kept.items():
            self.record[name][row] = address_of(_array_of(to))


def _array_of(to: NDArray[Any] | Pointers) -> NDArray[Any]:
    return to.record if isinstance(to, Pointers) else to


def address_of(array: NDArray[Any]) -> int:
    """The address of a contiguous array's first element.

    Raises:
        ValueError: the array is not contiguous, aligned and in this machine's byte order.
    """
    flags = array.flags
    if not (flags.c_contiguous and flags.aligned and array.dtype.isnative):
        raise ValueError(f"an array of shape {array.shape} is not contiguous, aligned and native")
    return int(array.ctypes.data)


def _viewer(item: Any, ndim: int) -> Any:
    """An intrinsic (address, *shape) -> array that owns nothing, so that nothing is counted."""
    array_type = types.Array(item, ndim, "C")

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = make_array(array_type)(context, builder)  # type: ignore[no-untyped-call]
        size = context.get_abi_sizeof(context.get_data_type(item))
        itemsize = context.get_constant(types.intp, size)
        shape = [builder.sext(arg, itemsize.type) for arg in args[1:]]
        strides = [itemsize]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        pack: Any = cgutils.pack_array
        fill: Any = populate_array
        fill(
            array,
            data=builder.inttoptr(args[0], context.get_data_type(item).as_pointer()),
            shape=pack(builder, shape),
            strides=pack(builder, strides),
            itemsize=itemsize,
            meminfo=None,
        )
        return array._getvalue()

    def three(typingctx: Any, address: Any, n: Any, m: Any, k: Any) -> Any:
        return array_type(types.uint64, types.int64, types.int64, types.int64), lower

    def one(typingctx: Any, address: Any, n: Any) -> Any:
        return array_type(types.uint64, types.int64), lower

    def two(typingctx: Any, address: Any, n: Any, m: Any) -> Any:
        return array_type(types.uint64, types.int64, types.int64), lower

    makers: tuple[Any, ...] = (one, two, three)
    return intrinsic(makers[ndim - 1])


@intrinsic
def _fetch_line(typingctx: Any, address: Any) -> Any:
    """Ask for a cache line to be loaded, without waiting for it; any address will do."""

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number, pointer = ir.IntType(32), cgutils.voidptr_t
        kind = ir.FunctionType(ir.VoidType(), [pointer, number, number, number])
        insert: Any = cgutils.get_or_insert_function
        function = insert(builder.module, kind, "llvm.prefetch.p0")
        read, keep, data = (ir.Constant(number, value) for value in (0, 3, 1))
        builder.call(function, [builder.inttoptr(args[0], pointer), read, keep, data])
        return context.get_dummy_value()

    return types.void(types.uint64), lower


_fetch = cast("Callable[[Any], None]", _fetch_line)


@inlined
def prefetch(address: Any, size: int) -> None:
    """Prefetch `size` bytes at an address into the cache."""
    for k in range(0, size, 64):
        _fetch(np.uint64(address) + np.uint64(k))


def rows_of(dtype: np.dtype[Any]) -> Callable[[Any, int], NDArray[np.void]]:
    """A kernel function (address, n) -> records (n,) of a dtype."""
    viewer = _viewer(from_dtype(dtype), 1)
    viewer.source_digest = repr(dtype)  # a kernel that calls it is stale when the record changes
    return cast("Callable[[Any, int], NDArray[np.void]]", viewer)


@intrinsic
def _on_stack(typingctx: Any, size: Any) -> Any:
    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = builder.alloca(ir.IntType(8), args[0])
        place.align = 64
        return builder.ptrtoint(place, ir.IntType(64))

    return types.uint64(types.int64), lower


# The address of n bytes that hold anything, until the kernel that asks for them returns.
on_stack = cast("Callable[[int], Any]", _on_stack)

# numba gives these the arguments that their callers see; mypy knows only how they are declared.
doubles_at = cast("Callable[[Any, int], NDArray[np.float64]]", _viewer(types.float64, 1))
floats_at = cast("Callable[[Any, int], NDArray[np.float32]]", _viewer(types.float32, 1))
words_at = cast("Callable[[Any, int], NDArray[np.uint32]]", _viewer(types.uint32, 1))
keys_at = cast("Callable[[Any, int], NDArray[np.uint64]]", _viewer(types.uint64, 1))
flags_at = cast("Callable[[Any, int], NDArray[np.bool_]]", _viewer(types.boolean, 1))
integers_at = cast("Callable[[Any, int], NDArray[np.int64]]", _viewer(types.int64, 1))
states_at = cast("Callable[[Any, int, int, int], NDArray[np.uint32]]", _viewer(types.uint32, 3))
moves_at = cast("Callable[[Any, int, int, int], NDArray[np.int32]]", _viewer(types.int32, 3))
table_at = cast("Callable[[Any, int, int], NDArray[np.float64]]", _viewer(types.float64, 2))
field_at = cast("Callable[[Any, int, int], NDArray[np.float32]]", _viewer(types.float32, 2))
