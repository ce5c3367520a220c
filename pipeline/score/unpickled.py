"""npy files of Python objects, as DexGraspNet and BODex publish them, read without executing anything.

Such a file holds a pickle: a program for a stack machine that builds objects, and may name any function and call it.
``pickletools.genops`` only takes that program apart. The reader here carries out the steps that build dictionaries,
lists, tuples, texts, numbers and arrays of numbers; a name that stands for anything else is refused before it could be
looked up.
"""

from __future__ import annotations

import pickletools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.records.errors import UserError

MOST_VALUES = 10_000_000  # what a few bytes can stand for has no bound, as a list may hold one list many times
NUMBERS = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248]|[SU]\d{1,4})")
OBJECTS = re.compile(r"\|?O8?")


class Refused(ValueError):
    """The file asks for something that is not plain data; the message says what."""


@dataclass
class _Dtype:
    """A type of array elements as the pickle describes it, in parts."""

    kind: str
    order: str = "="

    @property
    def dtype(self) -> np.dtype[Any]:
        order = "" if self.order in "|=" else self.order
        return np.dtype(object) if OBJECTS.fullmatch(self.kind) else np.dtype(order + self.kind.lstrip("<>|="))


@dataclass
class _Array:
    """An array under construction; plain once :func:`_plain` has replaced it."""

    value: Any = None


def _dtype(kind: Any, *_: Any) -> _Dtype:
    if not isinstance(kind, str) or not (NUMBERS.fullmatch(kind) or OBJECTS.fullmatch(kind)):
        raise Refused(f"the array type {str(kind)[:40]!r}")
    return _Dtype(kind, kind[0] if kind[0] in "<>|=" else "=")


def _filled(dtype: _Dtype, shape: Any, content: Any, columns_first: bool) -> Any:
    """Return an array of numbers, or nested lists where its elements are objects."""
    shape = tuple(int(length) for length in shape)
    count = int(np.prod(shape, dtype=object)) if shape else 1
    if min(shape, default=0) < 0 or count > MOST_VALUES:
        raise Refused(f"an array of {count} values")
    if count == 0:
        return []
    order: Any = "F" if columns_first else "C"
    if dtype.dtype == object:
        if not isinstance(content, list) or len(content) != count:
            raise Refused("an array of objects that lacks some of them")
        places = np.arange(count).reshape(shape, order=order)
        return _nested(places, content)
    if not isinstance(content, bytes | bytearray) or len(content) != count * dtype.dtype.itemsize:
        raise Refused("an array whose bytes do not fit its shape")
    return np.frombuffer(bytes(content), dtype.dtype).reshape(shape, order=order).copy()


def _nested(places: Any, content: list[Any]) -> Any:
    if places.ndim == 0:
        return content[int(places)]
    return [_nested(own, content) for own in places]


def _scalar(dtype: _Dtype, content: Any = b"") -> Any:
    return _filled(dtype, (), content, False)[()]


def _from_buffer(content: Any, dtype: _Dtype, shape: Any, order: str = "C") -> _Array:
    return _Array(_filled(dtype, shape, content, order == "F"))


def _as_bytes(text: Any, encoding: Any) -> bytes:
    if encoding != "latin1" or not isinstance(text, str):
        raise Refused("a text in an unusual encoding")
    return text.encode("latin1")


def _empty_array(*_: Any) -> _Array:
    return _Array()


# Everything that may be called, by its name in the pickle; numpy 2 calls `core` `_core`.
CALLABLE: dict[str, Callable[..., Any]] = {
    "numpy dtype": _dtype,
    "numpy.core.multiarray _reconstruct": _empty_array,
    "numpy.core.multiarray scalar": _scalar,
    "numpy.core.numeric _frombuffer": _from_buffer,
    "_codecs encode": _as_bytes,
    "builtins bytearray": lambda content=b"": bytes(content) if isinstance(content, bytes) else b"",
    "collections OrderedDict": lambda *_: {},
}
NAMES_ONLY = ("numpy ndarray",)  # may be named as an argument, not called


@dataclass(frozen=True)
class _Name:
    """A function or class that a pickle names."""

    text: str


class _Mark:
    """Where arguments begin on the stack."""


def _name(module: str, attribute: str) -> _Name:
    text = f"{module.replace('numpy._core', 'numpy.core')} {attribute}"
    if text not in CALLABLE and text not in NAMES_ONLY:
        raise Refused(f"{module}.{attribute}")
    return _Name(text)


class _Machine:
    """The stack machine; every method of the name of an opcode carries it out."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}

    def run(self, program: bytes) -> Any:
        """Return what the program builds.

        Raises:
            Refused: it would do anything but build plain data.
        """
        for opcode, argument, _ in pickletools.genops(program):
            if opcode.name == "STOP":
                return _plain(self.stack[-1])
            step = getattr(self, f"do_{opcode.name.lower()}", None)
            if step is not None:
                step(argument)
            elif opcode.name in _LITERALS:
                self.stack.append(_LITERALS[opcode.name](argument))
            else:
                raise Refused(f"the pickle instruction {opcode.name}")
        raise Refused("an end that is missing")

    def since_mark(self) -> list[Any]:
        """Take off the stack what lies above the last mark."""
        place = max(index for index, value in enumerate(self.stack) if isinstance(value, _Mark))
        taken = self.stack[place + 1 :]
        del self.stack[place:]
        return taken

    def last(self, count: int) -> list[Any]:
        """Take ``count`` values off the stack."""
        taken = self.stack[-count:]
        if len(taken) < count:
            raise Refused("values that are missing")
        del self.stack[-count:]
        return taken

    def do_proto(self, _: Any) -> None:
        pass

    do_frame = do_proto

    def do_mark(self, _: Any) -> None:
        self.stack.append(_Mark())

    def do_pop(self, _: Any) -> None:
        self.last(1)

    def do_memoize(self, _: Any) -> None:
        self.memo[len(self.memo)] = self.stack[-1]

    def do_binput(self, number: int) -> None:
        self.memo[number] = self.stack[-1]

    do_put = do_long_binput = do_binput

    def do_binget(self, number: int) -> None:
        self.stack.append(self.memo[int(number)])

    do_get = do_long_binget = do_binget

    def do_tuple(self, _: Any) -> None:
        self.stack.append(tuple(self.since_mark()))

    def do_list(self, _: Any) -> None:
        self.stack.append(self.since_mark())

    def do_dict(self, _: Any) -> None:
        self.stack.append({})
        values = self.since_mark_below()
        self.stack[-1].update(_pairs(values))

    def since_mark_below(self) -> list[Any]:
        """Take what lies between the last mark and the top of the stack, and leave the top."""
        top = self.stack.pop()
        values = self.since_mark()
        self.stack.append(top)
        return values

    def do_tuple1(self, _: Any) -> None:
        self.stack.append(tuple(self.last(1)))

    def do_tuple2(self, _: Any) -> None:
        self.stack.append(tuple(self.last(2)))

    def do_tuple3(self, _: Any) -> None:
        self.stack.append(tuple(self.last(3)))

    def do_append(self, _: Any) -> None:
        values = self.last(1)
        self.into(list).extend(values)

    def do_appends(self, _: Any) -> None:
        values = self.since_mark()
        self.into(list).extend(values)

    def do_setitem(self, _: Any) -> None:
        values = self.last(2)
        self.into(dict).update(_pairs(values))

    def do_setitems(self, _: Any) -> None:
        values = self.since_mark()
        self.into(dict).update(_pairs(values))

    def into(self, kind: type) -> Any:
        """Return the container on top of the stack."""
        if not isinstance(self.stack[-1], kind):
            raise Refused("a container of another kind than its content")
        return self.stack[-1]

    def do_global(self, argument: str) -> None:
        module, _, attribute = argument.partition(" ")
        self.stack.append(_name(module, attribute))

    def do_stack_global(self, _: Any) -> None:
        module, attribute = self.last(2)
        self.stack.append(_name(str(module), str(attribute)))

    def do_reduce(self, _: Any) -> None:
        function, arguments = self.last(2)
        if not isinstance(function, _Name) or function.text not in CALLABLE or not isinstance(arguments, tuple):
            raise Refused("a call of what is no known function")
        self.stack.append(CALLABLE[function.text](*arguments))

    def do_build(self, _: Any) -> None:
        target, state = self.last(2)
        if isinstance(target, _Array) and isinstance(state, tuple) and len(state) == 5:
            _, shape, dtype, columns_first, content = state
            target.value = _filled(dtype, shape, content, bool(columns_first))
        elif isinstance(target, _Dtype) and isinstance(state, tuple) and len(state) >= 5 and state[2:4] == (None, None):
            if state[1] not in ("<", ">", "|", "="):
                raise Refused("an unknown byte order")
            target.order = state[1]
        else:
            raise Refused("the state of an object that is no array")
        self.stack.append(target)


_LITERALS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("NONE",), lambda _: None),
    **dict.fromkeys(("NEWTRUE",), lambda _: True),
    **dict.fromkeys(("NEWFALSE",), lambda _: False),
    **dict.fromkeys(("EMPTY_DICT",), lambda _: {}),
    **dict.fromkeys(("EMPTY_LIST",), lambda _: []),
    **dict.fromkeys(("EMPTY_TUPLE",), lambda _: ()),
    **dict.fromkeys(
        (
            *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
            *("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8"),
            *("BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "STRING", "BINSTRING", "SHORT_BINSTRING"),
        ),
        lambda value: value,
    ),
    **dict.fromkeys(("BYTEARRAY8",), bytes),
}


def _pairs(values: list[Any]) -> dict[Any, Any]:
    keys = values[::2]
    if len(values) % 2 or not all(isinstance(key, str | int | float | bytes | bool) for key in keys):
        raise Refused("a dictionary with keys that are neither texts nor numbers")
    return dict(zip(keys, values[1::2], strict=True))


def _plain(value: Any, known: dict[int, tuple[Any, int]] | None = None, above: frozenset[int] = frozenset()) -> Any:
    """Return a value with its arrays in place; refuse one that contains itself or stands for too many values."""
    return _measured(value, {} if known is None else known, above)[0]


def _measured(value: Any, known: dict[int, tuple[Any, int]], above: frozenset[int]) -> tuple[Any, int]:
    if isinstance(value, _Array):
        if value.value is None:
            raise Refused("an array without content")
        return _measured(value.value, known, above)
    if isinstance(value, np.ndarray):
        return value, value.size
    if isinstance(value, _Name | _Mark | _Dtype):
        raise Refused("a function or type in the place of a value")
    if not isinstance(value, dict | list | tuple):
        return value, 1
    if id(value) in above or len(above) > 50:
        raise Refused("a value that contains itself, or is nested too deeply")
    if id(value) not in known:
        inside = above | {id(value)}
        parts = value.values() if isinstance(value, dict) else value
        done = [_measured(part, known, inside) for part in parts]
        size = 1 + sum(count for _, count in done)
        if size > MOST_VALUES:
            raise Refused(f"more than {MOST_VALUES} values")
        plain = [part for part, _ in done]
        known[id(value)] = (dict(zip(value, plain, strict=True)) if isinstance(value, dict) else plain), size
    return known[id(value)]


def read_npy(source: Path) -> Any:
    """Return the content of an npy file: an array of numbers or, of an array of objects, plain nested data.

    Raises:
        UserError: the file is missing or damaged, or holds anything but plain data, which is named.
    """
    try:
        with source.open("rb") as file:
            version = np.lib.format.read_magic(file)
            read_header = (
                np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            )
            shape, _, dtype = read_header(file)
            if not dtype.hasobject:
                file.seek(0)
                return np.load(file, allow_pickle=False)
            content = file.read()
    except FileNotFoundError as error:
        raise UserError(f"{source} is missing; name a file of grasps.") from error
    except Exception as error:  # numpy's reader of headers raises whatever the damage happens to trigger
        raise UserError(f"{source} is no npy file that can be read ({str(error)[:120]}); export it again.") from error
    try:
        return _Machine().run(content)
    except Refused as error:
        raise UserError(
            f"{source} holds {error}, which is no plain data, and nothing in a file is executed here; save the grasps "
            "as dictionaries, lists and arrays of numbers, or as JSON."
        ) from error
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError, EOFError) as error:
        raise UserError(
            f"{source} is damaged ({type(error).__name__}: {str(error)[:120]}); export it again."
        ) from error
