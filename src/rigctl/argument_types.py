"""The types of the arguments of public functions, checked where a user calls them.

In: a function with annotations. Out: the same function, which refuses `compare("latest", model)` with a
message that names the argument, what it has to be, and the function that returns such an object.
Otherwise the call would fail somewhere inside rigctl, with an error that names neither.

It is written by hand rather than taken from pydantic: annotations are evaluated at the first call, when
names that are imported for type checkers exist, NumPy's numbers count as numbers and `"3"` does not, and
nothing is copied.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Sized
from functools import cache, wraps
from inspect import Signature, signature
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Final, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from rigctl.errors import RigctlError

P = ParamSpec("P")
T = TypeVar("T")

#: what an argument of each plain type is called, and the types that are taken for it
_PLAIN: Final[Mapping[object, tuple[str, Any]]] = {
    str: ("text", str),
    Path: ("a path", (str, os.PathLike)),
    int: ("a whole number", Integral),
    float: ("a number", Real),
    NoneType: ("None", NoneType),
}
_LISTS: Final = (Sequence, Collection, Iterable)
#: the functions that return an object of each class
_MADE_BY: Final[Mapping[str, str]] = {
    "Comparison": "rigctl.compare",
    "Effect": "rigctl.find_effect",
    "Model": "rigctl.load_model",
    "ModelFamily": "rigctl.find_family",
    "Plan": "rigctl.expand",
    "Procedure": "rigctl.load_procedure",
    "Rig": "rigctl.load_rig",
    "Run": "rigctl.open_run",
}


def checks_argument_types(function: Callable[P, T]) -> Callable[P, T]:
    """Refuse an argument that is not of the type in the signature: ``compare("latest", model)``.

    Checked are also the elements of lists and mappings. A path may be text, and a number one of NumPy.

    Raises
    ------
    RigctlError
        names the argument, what it has to be, and the function that returns such an object.
    """
    called = signature(function)

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> T:
        _check(function, called, args, kwargs)
        return function(*args, **kwargs)

    return checked


def _check(function: Callable[..., Any], called: Signature, args: Any, kwargs: Any) -> None:
    try:
        given = called.bind(*args, **kwargs).arguments
    except TypeError:  # an argument is missing or unknown; the call itself names the function
        return
    for name, kind in _types(function).items():
        if name in given and not _is(given[name], kind):
            value = given[name]
            raise RigctlError(
                f"{function.__qualname__}: wrong kind of value for {name}",
                value=value if isinstance(value, str) else repr(value),
                expected=_called(kind),
                hint=_remedy(value, kind),
            )


@cache
def _types(function: Callable[..., Any]) -> Mapping[str, Any]:
    """The type of each argument; evaluated at the first call, when all modules have been imported."""
    written = {name: kind for name, kind in function.__annotations__.items() if name != "return"}
    return get_type_hints(SimpleNamespace(__annotations__=written), globalns=_globals(function))


def _globals(function: Callable[..., Any]) -> dict[str, Any]:
    """The names of the module that defines the function."""
    inner = getattr(function, "__wrapped__", None)
    found: dict[str, Any] = _globals(inner) if inner is not None else getattr(function, "__globals__", {})
    return found


def _is(value: Any, kind: Any) -> bool:
    origin, inner = get_origin(kind), get_args(kind)
    if kind in _PLAIN:
        fits = isinstance(value, _PLAIN[kind][1])
    elif kind is bool:
        fits = type(value).__name__ in ("bool", "bool_")
    elif origin in (Union, UnionType):
        fits = any(_is(value, each) for each in inner)
    elif origin is Literal:
        fits = value in inner
    elif origin is Mapping:
        fits = isinstance(value, Mapping) and all(
            _is(name, inner[0]) and _is(each, inner[1]) for name, each in value.items()
        )
    elif origin in _LISTS:
        fits = _is_list(value, origin) and all(_is(each, inner[0]) for each in _elements(value))
    elif origin is Callable:
        fits = callable(value)
    elif getattr(kind, "_is_protocol", False):
        fits = all(hasattr(value, name) for name in vars(kind) if not name.startswith("_"))
    else:
        fits = not isinstance(kind, type) or isinstance(value, kind)
    return fits


def _is_list(value: object, origin: Any) -> bool:
    """Whether it has elements, and keeps them where they are read twice; text is no list."""
    keeps = origin is Iterable or isinstance(value, Sized)
    return isinstance(value, Iterable) and keeps and not isinstance(value, (str, bytes, Mapping))


def _elements(value: Iterable[Any]) -> Iterable[Any]:
    return value if isinstance(value, Sized) else ()


def _called(kind: Any) -> str:
    """What a value of this type is called in a message."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind in _PLAIN:
        name = _PLAIN[kind][0]
    elif kind is bool:
        name = "True or False"
    elif origin in (Union, UnionType):
        name = " or ".join(_called(each) for each in inner if each is not str or Path not in inner)
    elif origin is Literal:
        name = " or ".join(map(repr, inner))
    elif origin is Mapping:
        name = f"a mapping of {_called(inner[0])} to {_called(inner[1])}"
    elif origin in _LISTS:
        name = f"a list, each element {_called(inner[0])}"
    elif origin is Callable:
        name = "a function"
    else:
        name = getattr(kind, "__name__", str(kind))
        name = f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
    return name


def _remedy(value: object, kind: Any) -> str | None:
    if get_origin(kind) in _LISTS and _is(value, get_args(kind)[0]):
        return "Put it into a list: [ ]"
    names = [getattr(each, "__name__", "") for each in (kind, *get_args(kind))]
    made = next((_MADE_BY[name] for name in names if name in _MADE_BY), None)
    return f"{made} returns one" if made else None
