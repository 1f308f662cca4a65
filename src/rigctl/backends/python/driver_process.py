"""The process of a driver: imports its package, makes the driver, and calls it for one line after another.

It is started by ``python -P -m rigctl.backends.python.driver_process``. The first line on stdin is its
settings as JSON (`rigctl.backends.python.create.settings_of`), each further one a line of
`rigctl.rig.protocols.client_lines`. It writes one JSON object a line: ``{"calls": NAME}`` before each call
into the driver, ``{"answer": TEXT}`` after a line, ``{"lost": WHY}`` where the driver cannot be trusted any
more. If its input ends without ``quit`` after something was set, it makes the outputs safe by itself.
"""

from __future__ import annotations

import asyncio
import faulthandler
import inspect
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from queue import SimpleQueue
from typing import IO, Any

from rigctl.backends.transport.readback import is_near
from rigctl.child_process import module_command, own_stdin

_PART = re.compile(r"[^.\[\]]+")
_MOST = 120  # characters of what a driver says that are repeated
_BEYOND = 2.0  # s beyond the limit of a call after which the process ends, if nobody has ended it
_SUCCESSORS = 60  # processes in turn that try to make outputs safe once nobody is there
_PAUSE = 1.0  # s between them


class Untrusted(Exception):
    """The driver does something that no driver of this file does: it is lost."""


class Driver:
    """One driver, made of its settings.

    Parameters
    ----------
    settings: as `rigctl.backends.python.create.settings_of` makes them.
    says: takes what is written about the work, before it is done.
    """

    def __init__(self, settings: Mapping[str, Any], says: Callable[[str], None]) -> None:
        self._settings = settings
        self._says = says
        self._loop: asyncio.AbstractEventLoop | None = None
        self._set: dict[str, tuple[float, str]] = {}  # by actuator, the number last set, and its text
        # Announced first: importing a package may take long, or hang, and the limit is one for each call.
        self._says(f"import of {settings['driver']}")
        made = _class_of(settings["driver"])
        self._asynchronous = inspect.iscoroutinefunction(getattr(made, "connect", None))
        positional, named = _arguments(settings["port"], settings["arguments"])
        self._driver = self._carried_out("start", lambda: made(*positional, **named))
        for one in settings["begin"]:
            self._call(one)

    # --- lines --------------------------------------------------------------------------------------------

    def answer(self, line: str) -> str:
        """Return the answer to a line."""
        name, _, argument = line.partition(" ")
        if name == "identify":
            return self._identity()
        if name == "read":
            group = self._settings["reads"][int(argument)]
            return " ".join(self._reading(one, part) for one, part in group.items())
        try:
            if name == "write":
                self._write(*argument.split(" "))
            elif name == "safe":
                self._call(self._settings["safe"][int(argument)])
            else:
                return f"error not understood: {name}"
        except Untrusted:
            raise
        except Exception as error:  # noqa: BLE001 - a driver may raise anything; here it has refused
            return f"error {_text_of(error)}"
        return "ok"

    def leave(self) -> bool:
        """Make the outputs safe, as nobody else can any more; return whether the driver did all of it."""
        done = True
        for line in self._settings["leaving"]:
            try:
                done &= self.answer(line) == "ok"
            except Exception:  # noqa: BLE001 - the other outputs are still to be made safe
                done = False
        return done

    def _identity(self) -> str:
        known = f"driver {self._settings['driver']}, package {self._settings['package']}"
        wanted = self._settings["identify"]
        if wanted is None:
            return known
        value = self._value(wanted["get"])
        found = _one_line(value if wanted["item"] is None else _item(value, wanted))
        if wanted["equals"] is not None and found != wanted["equals"]:
            return f"not {wanted['equals']!r} but {found!r}"
        return f"{known}, identity {found}"

    def _reading(self, name: str, part: Mapping[str, Any]) -> str:
        """Return the number of a channel or the state of an actuator, as text; it is asked for again if the
        driver raises.

        Raises
        ------
        Untrusted
            the driver raises each time, or gives no number.
        """
        # A driver that raises may have met a damaged answer; one that raises each time cannot be trusted.
        for left in reversed(range(self._settings["tries"])):
            try:
                value = self._value(part["get"])
                break
            except Exception as error:
                if not left:
                    raise Untrusted(f"{part['get']} of the driver fails: {_text_of(error)}") from error
        if part["item"] is not None:
            value = _item(value, part)
        if part["values"] is not None:
            found = [number for number, held in part["values"].items() if _same(value, held)]
            return found[0] if found else "nan"
        number = self._number(value, part)
        if name not in self._settings["writes"]:
            return _written(number * part["scale"] + part["offset"])
        put, text = self._set.get(name, (math.nan, ""))
        return (
            text
            if is_near(number, put, part["within"])
            else _written(number * part["scale"] + part["offset"])
        )

    def _number(self, value: Any, part: Mapping[str, Any]) -> float:
        """Return the number that a driver gives, in the unit that the rig file states; NaN is one.

        Raises
        ------
        Untrusted
            it is no number, or the driver states another unit.
        """
        unit = getattr(value, "units", getattr(value, "unit", None))
        magnitude = getattr(value, "magnitude", getattr(value, "value", value)) if unit is not None else value
        with suppress(TypeError, ValueError):  # arrays have a dtype and a length
            if not isinstance(magnitude, str | bytes) and not hasattr(magnitude, "__len__"):
                number = float(magnitude)
                self._require_unit("" if unit is None else str(unit), part["get"], part["unit"])
                return number
        kind = type(magnitude).__name__
        raise Untrusted(f"{part['get']} of the driver gives no number but {_one_line(magnitude)} ({kind})")

    def _require_unit(self, stated: str, path: str, unit: str) -> None:
        """Require that a unit stated by the driver, if any, is that of the rig file."""
        from rigctl.errors import RigctlError
        from rigctl.units import parse_unit

        if "" in (stated, unit) or stated == unit:
            return
        self._says(f"check of the unit of {path}")  # the import of pint is no time of the driver's
        try:
            found, wanted = parse_unit(stated), parse_unit(unit)
            same = (found.dimension, found.factor, found.offset) == (
                wanted.dimension,
                wanted.factor,
                wanted.offset,
            )
        except RigctlError:
            same = False
        if not same:
            raise Untrusted(f"{path} of the driver is in {stated!r}; expected {unit!r}")

    def _write(self, name: str, text: str) -> None:
        part = self._settings["writes"][name]
        if part["values"] is not None:
            self._put(part, part["values"][f"{float(text):g}"])
            return
        number = (float(text) - part["offset"]) / part["scale"]
        self._put(part, number)
        self._set[name] = (number, text)

    # --- the driver ---------------------------------------------------------------------------------------

    def _value(self, path: str) -> Any:
        """Return the value of an attribute, a parameter, a signal, or a method."""

        def get() -> Any:
            found = _resolve(self._driver, path)
            if callable(getattr(found, "get_value", None)):  # a signal of ophyd-async
                return _with_unit(found)
            if not callable(found):
                return found
            unit = getattr(found, "unit", None)  # of a parameter of QCoDeS
            return _Stated(found(), unit) if isinstance(unit, str) else found()

        return self._carried_out(f"get {path}", get)

    def _put(self, part: Mapping[str, Any], value: Any) -> None:
        """Set an attribute, a parameter or a signal, or call a method with a value."""
        path = part["set"]

        def put() -> Any:
            owner, name = _owner(self._driver, path)
            if not name.startswith("[") and _is_attribute(owner, name):
                setattr(owner, name, value)
                return None
            found = _element(owner, name)
            if callable(found):
                unit = getattr(found, "unit", None)
                if isinstance(unit, str) and part["values"] is None:
                    self._require_unit(unit, path, part["unit"])
                return found(value)
            if callable(getattr(found, "set", None)):
                return found.set(value)
            setattr(owner, name, value)
            return None

        self._carried_out(f"set {path}", put)

    def _call(self, one: Mapping[str, Any]) -> None:
        self._carried_out(
            f"call {one['call']}", lambda: _resolve(self._driver, one["call"])(**one["arguments"])
        )

    def _carried_out(self, what: str, work: Callable[[], Any]) -> Any:
        """Return the result of a piece of work, of which may have to be waited for.

        An asynchronous driver, which has a coroutine ``connect``, is used in its event loop only.
        """
        self._says(what)
        if self._asynchronous:

            async def inside() -> Any:
                found = work()
                return await found if inspect.isawaitable(found) else found

            return self._waited(inside())
        found = work()
        return self._waited(_awaiting(found)) if inspect.isawaitable(found) else found

    def _waited(self, work: Any) -> Any:
        if self._loop is None:
            self._loop = asyncio.new_event_loop()
            threading.Thread(target=self._loop.run_forever, daemon=True, name="driver").start()
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()


async def _awaiting(work: Awaitable[Any]) -> Any:
    return await work


async def _with_unit(signal_of: Any) -> Any:
    """Return the value of a signal, with the unit that it describes, if it does."""
    described = await signal_of.describe() if hasattr(signal_of, "describe") else {}
    unit = dict(next(iter(described.values()), {})).get("units")
    value = await signal_of.get_value()
    return _Stated(value, unit) if unit else value


class _Stated:
    """A value whose unit the driver states."""

    def __init__(self, magnitude: Any, units: object) -> None:
        self.magnitude = magnitude
        self.units = units


# --- names and values -------------------------------------------------------------------------------------


def _class_of(name: str) -> Any:
    """Return the class of a package; only of the package itself, not of what it has imported.

    Raises
    ------
    Untrusted
        there is none.
    """
    from importlib import import_module

    from rigctl.errors import nearest_name

    module_name, _, path = name.partition(":")
    try:
        found: Any = import_module(module_name)
    except Exception as error:
        raise Untrusted(f"{module_name} cannot be imported: {_text_of(error)}") from error
    for part in path.split("."):
        if not hasattr(found, part):
            near = nearest_name(part, [one for one in dir(found) if not one.startswith("_")])
            also = f"; did you mean {near!r}?" if near else ""
            raise Untrusted(f"{module_name} has no {path!r}{also}")
        found = getattr(found, part)
    package = module_name.partition(".")[0]
    if not inspect.isclass(found) or found.__module__.partition(".")[0] != package:
        raise Untrusted(f"{name} is no class of {package}")
    return found


def _arguments(port: str | None, given: Mapping[str, Any]) -> tuple[list[Any], dict[str, Any]]:
    """Return the arguments of the driver, with its port in its place."""
    if port is None:
        return [], dict(given)
    used = False

    def filled(value: Any) -> Any:
        nonlocal used
        if isinstance(value, str) and "{port}" in value:
            used = True
            return value.replace("{port}", port)
        if isinstance(value, dict):
            return {name: filled(one) for name, one in value.items()}
        return [filled(one) for one in value] if isinstance(value, list) else value

    named = {name: filled(value) for name, value in given.items()}
    return ([] if used else [port]), named


def _resolve(driver: Any, path: str) -> Any:
    owner, name = _owner(driver, path)
    return _element(owner, name)


def _owner(driver: Any, path: str) -> tuple[Any, str]:
    """Return what an attribute or an element belongs to, and its name; ``[2]`` for an element."""
    parts = [
        f"[{found[0]}]" if path[found.start() - 1 : found.start()] == "[" else found[0]
        for found in _PART.finditer(path)
    ]
    for part in parts[:-1]:
        driver = _element(driver, part)
    return driver, parts[-1]


def _element(owner: Any, name: str) -> Any:
    if not name.startswith("["):
        try:
            return getattr(owner, name)
        except AttributeError as error:
            if hasattr(type(owner), name):  # the attribute itself fails
                raise
            from rigctl.errors import nearest_name

            near = nearest_name(name, [one for one in dir(owner) if not one.startswith("_")])
            also = f"; did you mean {near!r}?" if near else ""
            raise Untrusted(f"{type(owner).__name__} has no {name!r}{also}") from error
    key = name[1:-1]
    return owner[int(key) if key.isdigit() else key]


def _is_attribute(owner: Any, name: str) -> bool:
    """Return whether a name is a property, which is set without being read before."""
    return hasattr(inspect.getattr_static(type(owner), name, None), "__set__")


def _item(value: Any, part: Mapping[str, Any]) -> Any:
    try:
        return value[part["item"]]
    except (TypeError, KeyError, IndexError):
        raise Untrusted(
            f"{part['get']} of the driver has no element {part['item']!r}: {_one_line(value)}"
        ) from None


def _same(value: Any, held: Any) -> bool:
    """Return whether a driver's value is that of a position; a text is compared without case."""
    if isinstance(value, str) and isinstance(held, str):
        return value.casefold() == held.casefold()
    with suppress(Exception):
        return bool(value == held)
    return False


def _written(number: float) -> str:
    return f"{number:.9e}" if math.isfinite(number) else "nan"


def _text_of(error: BaseException) -> str:
    return f"{type(error).__name__}: {_one_line(error)}".removesuffix(": ").removeprefix("Untrusted: ")


def _one_line(value: object) -> str:
    try:
        text = " ".join(str(value).split())
    except Exception:  # noqa: BLE001 - a driver's object may not even have a text
        text = type(value).__name__
    return text if len(text) <= _MOST else f"{text[:_MOST]}…"


# --- the process ------------------------------------------------------------------------------------------


def start_process() -> subprocess.Popen[str]:
    """Start the process of a driver, which still waits for its settings."""
    return subprocess.Popen(  # noqa: S603 - this Python, no shell
        module_command("rigctl.backends.python.driver_process"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        start_new_session=True,
    )


class _Watch:
    """How long the driver has been in its call, and what happens if nobody else looks after that.

    Parameters
    ----------
    settings: of the driver; ``successors`` is there in a process that is to make outputs safe and no more.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._settings = settings
        self._limit = float(settings["wake"])
        self._since = time.monotonic()
        self._dumped = open(os.devnull, "w")  # noqa: SIM115, PTH123 - as long as the process lives
        self._over = threading.Event()
        self._orphaned = False  # nobody is left to start another process
        self.touched = "successors" in settings

    def called(self) -> None:
        """Note that a call begins. It ends the process beyond its limit, whatever the driver does: this timer
        is no Python code."""
        self._since = time.monotonic()
        faulthandler.dump_traceback_later(self._limit + _BEYOND, exit=True, file=self._dumped)

    def returned(self) -> None:
        """Note that the driver has done what it was asked to do, and has its usual limit from now on."""
        faulthandler.cancel_dump_traceback_later()
        self._since, self._limit = math.inf, float(self._settings["timeout"])

    def left(self) -> None:
        """Note that the process is about to end."""
        self._over.set()

    def outlive(self) -> None:
        """Wait for the end of the process, as its input has ended; a driver that hangs is succeeded."""
        self._orphaned = True
        while not self._over.wait(0.05):
            if time.monotonic() - self._since > self._limit:
                if self.touched:
                    self.succeed()
                os._exit(1)

    def succeed(self) -> None:
        """Leave the outputs to another process of the driver, unless there is a guard that has one."""
        left = int(self._settings.get("successors", _SUCCESSORS))
        if left <= 0 or not self._orphaned:
            return
        next_one = start_process()
        assert next_one.stdin is not None  # noqa: S101 - opened as a pipe
        with suppress(OSError):
            next_one.stdin.write(json.dumps({**self._settings, "successors": left - 1}) + "\n")
            next_one.stdin.close()


def main() -> int:
    """Serve until the input ends."""
    for name in ("SIGINT", "SIGHUP", "SIGBREAK"):  # meant for rigctl, which then ends this process
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    # Before the package is imported: a driver that prints at import must not write into the protocol.
    lines, out = _own_streams()
    settings = json.loads(lines.readline())
    watch = _Watch(settings)
    if "successors" in settings:
        time.sleep(_PAUSE)

    def say(**what: str) -> None:
        with suppress(OSError):  # nobody listens any more: the end of the input says so, too
            out.write(json.dumps(what) + "\n")
            out.flush()

    def calls(name: str) -> None:
        watch.called()
        say(calls=name)

    coming: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(lines, coming, watch), daemon=True).start()
    driver: Driver | None = None
    try:
        driver = Driver(settings, calls)
        watch.returned()
        say(answer="ready")
        # With "quit" the port was closed in an orderly way, with the outputs dealt with; without it the other
        # process was killed.
        while (line := coming.get()) not in ("", "quit"):
            watch.touched |= line.startswith("write ")
            answer = driver.answer(line)
            watch.returned()
            say(answer=answer)
        watch.touched &= line != "quit"
    except BaseException as error:  # noqa: BLE001 - a driver may even call sys.exit
        watch.returned()
        say(lost=_text_of(error))
    if watch.touched and not (driver is not None and driver.leave()):
        watch.succeed()
    watch.left()
    sys.stdout.flush()
    os._exit(0)  # a driver's threads may never end


def _listen(lines: IO[str], coming: SimpleQueue[str], watch: _Watch) -> None:
    """Pass on the lines of the input; its end is an empty one, and is seen while the driver is in a call."""
    for line in lines:
        if line.strip():
            coming.put(line.strip())
    coming.put("")
    watch.outlive()


def _own_streams() -> tuple[IO[str], IO[str]]:
    """Return this process's input and output, and keep the driver from both: it may print and ask."""
    lines = os.fdopen(own_stdin(), "r", encoding="utf-8")
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return lines, out


if __name__ == "__main__":
    sys.exit(main())
