"""Options of a backend, from a rig file or the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig import Rig

_FLAGS = {"on": True, "off": False, "true": True, "false": False, "yes": True, "no": False}


def refuse_unknown(kind: str, options: Mapping[str, object], known: Iterable[str]) -> None:
    """Refuse an unknown option, naming the nearest valid one."""
    names = tuple(known)
    for name in options:
        if name not in names:
            raise unknown_name(kind, name, names)


def read_port(rig: Rig, options: Mapping[str, object], question: str, expected: str, begins: str = "") -> str:
    """Return the port from the command line, or else from the rig file.

    Raises
    ------
    RigctlError
        neither gives a port (`question` and `expected` are then the message), or it does not begin with
        `begins`.
    """
    port = options.get("port") or rig.backend.port
    if isinstance(port, str) and port.startswith(begins):
        return port
    raise RigctlError(question, value=port if isinstance(port, str) else None, expected=expected)


def require_packages(device: str, library: str, extra: str, modules: Iterable[str]) -> None:
    """Refuse a `device` whose `library` is not installed; the message gives the command that installs it.

    Raises
    ------
    RigctlError
        one of the `modules` is missing.
    """
    if any(find_spec(module) is None for module in modules):
        raise RigctlError(f"{device} needs {library}", hint=f"pip install 'rigctl[{extra}]'")


def read_flag(name: str, given: object, *, default: bool) -> bool:
    """Read on or off; `default` if nothing is given."""
    if given is None:
        return default
    if isinstance(given, bool):
        return given
    if isinstance(given, str) and given.casefold() in _FLAGS:
        return _FLAGS[given.casefold()]
    raise RigctlError(f"{name} is switched on or off", value=str(given), expected="on or off")


def read_texts(name: str, given: object) -> tuple[str, ...]:
    """Read one text or several; none if nothing is given."""
    if given is None:
        return ()
    if isinstance(given, str):
        return (given,)
    if isinstance(given, Sequence) and all(isinstance(text, str) for text in given):
        return tuple(given)
    raise RigctlError(f"{name} is a text or a list of texts", value=str(given))
