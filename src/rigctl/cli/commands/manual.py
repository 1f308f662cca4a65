"""`rigctl off`, `jog` and `monitor`: manual operation of the bench.

The commands only find the rig, the address and the person; what they do is in `rigctl.runner.switch_off`
and `rigctl.runner.manual`. `off` is kept apart from all that takes time to import: it must work on a busy
computer, without a project, and with nothing but a port.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.driver import AllowDriverOption
from rigctl.cli.options.port import PortOption
from rigctl.errors import ExitCode, RigctlError

if TYPE_CHECKING:
    from rigctl.backends.protocol import Sample
    from rigctl.rig import Rig
    from rigctl.runner.bench_access import Access
    from rigctl.runner.manual import DeviceState, Reading

_NO_ANSWER = 1.5  # s after which the operator is told what to do by hand

RigFile = Annotated[Path | None, typer.Option(help="Rig file; by default the project's.", show_default=False)]
Backend = Annotated[str | None, typer.Option(help="Backend; by default that of the rig file.")]
Speed = Annotated[str, typer.Option(help="Speed of a simulated, emulated or replayed bench: 1x, 10x or max.")]


def off(
    rig: RigFile = None,
    backend: Backend = None,
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    *,
    clear_trips: Annotated[
        bool, typer.Option("--clear-trips", help="Also clear latched trips; their cause must be gone.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Put every output of the bench into its safe state immediately, and read it back.

    Runs in progress on it are ended, including simulated ones. With --port alone, the device that answers
    determines the bench: rigctl's own board, or the two-heater board.

    Example: rigctl off --rig rigs/hl32-bench.yaml
    """
    from rigctl.runner.switch_off import switch_off

    say_guards()
    # From here on the operator is told after a moment not to wait, whatever hangs.
    with _impatient():
        bench = open_rig_at(port[0]) if rig is None and port else open_rig(rig)
        result = switch_off(bench, access_of(bench, backend, port, "1x", clear_trips=clear_trips))
    document = {
        "rig": bench.name,
        "done": result.done,
        "confirmed": result.confirmed,
        "known_by": result.known_by,
    }
    if as_json:
        print_json({**document, "ended": result.ended}, indent=None)
    elif result.confirmed:
        echo(result.done)
    else:
        typer.secho(result.done, fg=typer.colors.RED, bold=True, err=True)
    if not result.confirmed:
        raise typer.Exit(ExitCode.FAILED)


@contextmanager
def _impatient() -> Iterator[None]:
    """Print what to do by hand while nothing has answered; a board that restarts needs some seconds."""

    def say() -> None:
        text = "no answer yet; do not wait for it: switch the bench off by hand, at its supply"
        typer.secho(text, fg=typer.colors.RED, bold=True, err=True)

    timer = threading.Timer(_NO_ANSWER, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def jog(
    actuator: Annotated[str, typer.Argument(help="Name in the rig file.", show_default=False)],
    value: Annotated[str, typer.Argument(help="Name of a position, or a level with its unit.")],
    duration: Annotated[
        str | None, typer.Option("--for", help="Duration, e.g. '0.5 s'; by default until Enter.")
    ] = None,
    rig: RigFile = None,
    backend: Backend = None,
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    speed: Speed = "1x",
    *,
    readings: Annotated[
        bool, typer.Option("--readings", help="Also print each sample, as 'monitor' does.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Move one actuator by hand, within its range and under the interlocks; outputs are safe afterwards.

    A level with a max_rate is brought there at this rate, and --for counts from its arrival; the safe state
    is commanded at once.

    Example: rigctl jog valve extend --for "0.5 s"
    """
    from rigctl.cli.attended_run import report_end
    from rigctl.cli.options.quantities import read_option
    from rigctl.runner.launch import operated
    from rigctl.runner.manual import jog as carry_out
    from rigctl.runner.manual import needs_person
    from rigctl.runner.operators.automatic_operator import AutomaticOperator
    from rigctl.runner.operators.console import Console

    bench = open_rig(rig)
    if duration is not None:
        read_option("--for", duration, "s")
    access = access_of(bench, backend, port, speed)
    by_person = needs_person(bench, actuator, duration, access)
    if by_person and speed == "max":
        raise RigctlError(
            f"{actuator}: its operator cannot answer at this speed",
            expected="--for, or --speed 1x",
            value=speed,
        )
    with Console("operator") as console:
        how = operated(access, console if by_person else AutomaticOperator(), console)
        on_sample = partial(_print_sample, bench, _as_json if as_json else _as_line) if readings else None
        result = carry_out(bench, actuator, value, duration, how, partial(_print_event, bench), on_sample)
    report_end(result, as_json=as_json)


def monitor(
    rig: RigFile = None,
    backend: Backend = None,
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    rate: Annotated[
        float | None, typer.Option(min=0.01, help="Sampling rate in Hz; by default that of the rig file.")
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Stop after this many samples.")] = None,
    duration: Annotated[str | None, typer.Option("--for", help="Stop after this time, e.g. '10 s'.")] = None,
    speed: Speed = "1x",
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document for each sample.")] = False,
) -> None:
    """Watch the channels without a run; outputs are safe. Ctrl-C ends it.

    Example: rigctl monitor --count 1 --json
    """
    from rigctl.cli.options.quantities import read_option
    from rigctl.runner.manual import watch

    bench = open_rig(rig)
    end = read_option("--for", duration, "s", above_zero=True).si if duration is not None else None
    say_guards()
    readings = watch(bench, access_of(bench, backend, port, speed), rate or bench.monitor_rate)
    first: float | None = None
    with _shown(bench, as_json=as_json) as show:
        for reading in islice(readings, count and min(count, sys.maxsize)):
            first = reading.sample.time if first is None else first
            if end is not None and reading.sample.time - first > end:
                break
            show(reading)
        readings.close()


@contextmanager
def _shown(rig: Rig, *, as_json: bool) -> Iterator[Callable[[Reading], None]]:
    """The display of readings: a table that redraws itself on a terminal, otherwise one line for each
    sample."""
    from rigctl.live import MonitorDisplay, redrawable

    if not as_json and redrawable(sys.stdout):
        with MonitorDisplay(rig, sys.stdout) as display:
            yield lambda reading: display(
                reading.sample, reading.alarms, reading.notices, _device_lines(reading.devices)
            )
        return
    line = _as_json if as_json else _as_line

    introduced: set[str] = set()

    def show(reading: Reading) -> None:
        for notice in reading.notices:
            echo(notice, err=True)
        if not introduced and not any(math.isnan(one.age) for one in reading.devices.values()):
            introduced.update(reading.devices)
            for text in _device_lines(reading.devices):
                echo(text, err=True)
        echo(line(rig, reading))

    yield show


def _device_lines(devices: Mapping[str, DeviceState]) -> list[str]:
    """One line for each of several devices: who it is, how fast it answers, and whose clock dates it."""
    lines = []
    for name, one in devices.items():
        known = ", ".join(text for text in one.identity.values() if text)
        answers = "" if math.isnan(one.answers_in) else f"; a sample takes {1e3 * one.answers_in:.3g} ms"
        clock = "its own clock" if one.own_clock else "this computer's clock"
        age = f"read {1e3 * one.age:.0f} ms ago, stale after {one.stale_after:.3g} s"
        lines.append(f"{name}: {known}{answers}; {clock}; {age}")
    return lines


def say_guards() -> None:
    """Report on stderr, in red, which supervisors are still trying to make a device safe."""
    from rigctl.backends.transport.safe_state_retries import retrying_guards

    for notice in retrying_guards():
        typer.secho(f"OUTPUTS MAY BE ON: {notice}", fg=typer.colors.RED, bold=True, err=True)


def open_rig(path: Path | None) -> Rig:
    """The rig at a path, or else that of the project.

    Raises
    ------
    RigctlError
        none is named, here or in the project file, and the project has none or several.
    """
    from rigctl.project import MARKER, find_file, find_project
    from rigctl.rig import load_rig

    project = find_project()
    chosen = path or project.rig
    if chosen is not None:
        return load_rig(find_file(chosen))
    paths = sorted((project.root / "rigs").glob("*.yaml"))
    if len(paths) == 1:
        return load_rig(paths[0])
    raise RigctlError(
        "which rig?",
        expected=" or ".join(f"--rig {rig.relative_to(project.root).as_posix()}" for rig in paths)
        or "--rig FILE",
        hint=f'{MARKER} can name one permanently: rig = "rigs/my-bench.yaml"',
    )


def open_rig_at(port: str) -> Rig:
    """The rig if only a port is given: the project's, or one for the device that answers there.

    Raises
    ------
    RigctlError
        nothing answers, or an unknown device.
    """
    from rigctl.backends.lines.probe import probe
    from rigctl.backends.transport.port import PortLost
    from rigctl.backends.transport.pyserial_port import PyserialPort
    from rigctl.clock import real_clock
    from rigctl.files.shipped import shipped
    from rigctl.rig import load_rig

    try:
        return open_rig(None)
    except RigctlError:
        pass  # no project, or several rigs: the port decides
    clock = real_clock()
    try:
        device = probe(lambda: PyserialPort(port, 115200, clock), clock, rounds=1)
    except PortLost as error:
        raise RigctlError(
            "the bench cannot be reached",
            value=str(error),
            hint="Switch it off by hand, at its supply; or name its rig with --rig",
            exit_code=ExitCode.FAILED,
        ) from None
    known = {"RIGCTL,": "hl32-bench-uno.yaml", "TCLab": "tclab-board.yaml"}
    for begin, name in known.items():
        if device.identity.startswith(begin):
            return load_rig(shipped("rigs", name))
    raise RigctlError(
        "the safe state of this device is not known", value=device.identity, expected="--rig FILE"
    )


def access_of(
    rig: Rig, backend: str | None, port: Sequence[str] | None, speed: str, *, clear_trips: bool = False
) -> Access:
    """The settings for operating a bench by hand, besides its rig file."""
    from rigctl.project import find_project
    from rigctl.runner.bench_access import Access, bench_options, clock_for

    kind = backend or rig.backend_named()
    return Access(
        runs=find_project().runs,
        backend=kind,
        options=bench_options(kind, rig, port=port, clear_trips=clear_trips),
        clock=clock_for(speed, kind),
    )


def _as_line(rig: Rig, reading: Reading) -> str:
    from rigctl.units import show

    sample = reading.sample
    parts = [f"{sample.time:8.2f} s"]
    for name, value in zip(rig.layout.channels, sample.values, strict=True):
        channel = rig.channels[name]
        text = "missing" if value != value else show(value, channel.unit, difference=channel.difference)  # noqa: PLR0124
        parts.append(f"{name} {text}")
    parts += [f"! {alarm.message}" for alarm in reading.alarms if alarm.active]
    return "  ".join(parts)


def _as_json(rig: Rig, reading: Reading) -> str:
    from rigctl.files.write import to_json

    layout, sample = rig.layout, reading.sample
    channels = {
        name: rig.channels[name].display.from_si(value, difference=rig.channels[name].difference)
        for name, value in zip(layout.channels, sample.values, strict=True)
    }
    commands = dict(zip(layout.commands, sample.commands, strict=True))
    document = {
        "time": sample.time,
        "channels": channels,
        "units": {name: layout.unit(name) for name in channels},
        "commands": {name: rig.actuators[name].show(value) for name, value in commands.items()},
        "alarms": [alarm.message for alarm in reading.alarms if alarm.active],
    }
    if reading.devices:
        document["devices"] = {
            name: {
                "age": None if math.isnan(one.age) else one.age,
                "stale_after": one.stale_after,
                "sample_takes": None if math.isnan(one.answers_in) else one.answers_in,
                "own_clock": one.own_clock,
            }
            for name, one in reading.devices.items()
        }
    return to_json(document, indent=None)


def _print_sample(rig: Rig, line: Callable[[Rig, Reading], str], sample: Sample) -> None:
    """Print a sample while the bench is moved by hand.

    Raises
    ------
    RigctlError
        nobody reads it any more, which ends the movement.
    """
    from rigctl.runner.manual import Reading

    try:
        echo(line(rig, Reading(sample, ())))
    except OSError as error:
        raise RigctlError("the readings are no longer read", exit_code=ExitCode.FAILED) from error


def _print_event(rig: Rig, time: float, kind: str, fields: Mapping[str, Any]) -> None:
    """Show events while the bench is moved by hand."""
    if kind == "command":
        text = f"{fields['actuator']} {rig.actuators[fields['actuator']].show(fields['value'])}"
    elif kind in ("alarm", "fault", "note"):
        text = str(fields.get("message", ""))
    else:
        return
    sys.stderr.write(f"{time:8.3f} s  {text}\n")
