"""What a user's functions of a model are given, and what they return: variables by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Never

from rigctl.errors import RigctlError, unknown_name


class Variables:
    """Some variables of a model by attribute or by key, ``p.mass`` or ``p["mass"]``, or in order, as
    ``angle, speed = x``."""

    def __init__(self, kind: str, names: Sequence[str], values: Any) -> None:
        self._kind, self._names, self._values = kind, tuple(names), values

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise unknown_name(self._kind, name, self._names)
        return self._values[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self[name]

    def __iter__(self) -> Iterator[Any]:
        return iter([self._values[name] for name in self._names])


class Numbers:
    """The same with numbers, which are attributes: a function is called some thousand times a simulation."""

    __slots__ = ("__dict__", "__kind")

    def __init__(self, kind: str, values: dict[str, float]) -> None:
        self.__dict__ = values
        self.__kind = kind

    def __getattr__(self, name: str) -> Never:
        if name.startswith("__"):
            raise AttributeError(name)
        raise unknown_name(self.__kind, name, self.__dict__)

    def __getitem__(self, name: str) -> float:
        return float(getattr(self, name))

    def __iter__(self) -> Iterator[float]:
        return iter(self.__dict__.values())


#: what the time is called in messages
_TIME = "the time t"


class Time:
    """The time of a record, on which no equation may depend: two records begin at other times of day."""

    def __repr__(self) -> str:
        return _TIME

    def _refuse(self, *_: object, **__: object) -> Never:
        raise RigctlError(
            "an equation may not depend on the time itself",
            hint="Make what changes with time an input, or a state with its rate",
        )

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __mod__ = __floordiv__ = __round__ = __int__ = __index__ = __array__ = _refuse
    __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = __float__ = __array_ufunc__ = _refuse
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = __bool__ = _refuse
    __hash__ = object.__hash__


def name_of(function: object) -> str:
    """What a user's function is called in messages."""
    return str(getattr(function, "__name__", "")) or repr(function)


def by_name(called: str, result: object, names: Sequence[str], kind: str) -> dict[str, Any]:
    """What a user's function returns, by name: a mapping, values in the order declared, or one value.

    Parameters
    ----------
    called: the function's name, and `kind` what it returns one of for each name.

    Raises
    ------
    RigctlError
        it does not return one value for each name.
    """
    if type(result) is dict and result.keys() == set(names):
        return result
    if isinstance(result, Mapping):
        found = dict(result)
    elif isinstance(result, str | bytes) or result is None:
        found = {}
    elif isinstance(result, Sequence) or getattr(result, "ndim", 0) == 1:
        values: list[Any] = list(result)  # type: ignore[call-overload]
        found = dict(zip(names, values, strict=True)) if len(values) == len(names) else {}
    else:
        found = {names[0]: result} if len(names) == 1 else {}
    if set(found) != set(names):
        raise RigctlError(
            f"{called} does not return one {kind} for each of {', '.join(names)}",
            value=repr(result),
            expected=f"a dict with these keys, or {len(names)} values in this order",
        )
    return found
