"""The checks of `rigctl doctor` on the bench: ports, devices that answer, the emulator, the rig files.

In: the ports of this computer, addresses to ask, or a rig file. Out: a `Finding` for each check, and
documents for programs. Nothing is set, and no port is opened that is not named by the user or in the rig
file: opening one may restart a board, and a query may disturb the device behind it.

A device described by a rig file is connected to as in a run, identified, and read once. Readings that are
impossible point to a wrong byte or word order; the other orders are tried, and one that gives possible
values is suggested.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.cli.commands.doctor.finding import Finding
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.backends.lines.probe import Found
    from rigctl.backends.lines.reading import OneReading
    from rigctl.backends.transport.serial_ports import PortInfo, PortsUnlisted
    from rigctl.rig import Rig


def port_findings(ports: Sequence[PortInfo] | PortsUnlisted) -> Iterator[Finding]:
    """Every port with its most likely device; a USB port without permission to open it is a problem."""
    from rigctl.backends.transport.serial_ports import PortsUnlisted, missing_port_fix

    if isinstance(ports, PortsUnlisted):
        fix = "name the port yourself, in the rig file or with --port; runs do not need the list"
        yield Finding("serial ports", "optional", f"the system cannot list them: {ports}", fix)
        return
    if not any(port.vendor is not None for port in ports):
        detail = "there is no USB port: no board is plugged in, or the system does not see it"
        yield Finding("serial ports", "optional", detail, missing_port_fix())
    for port in ports:
        parts = (port.guess or port.description, port.usb, port.serial_number or "")
        detail = ", ".join(part for part in parts if part and part != "n/a") or "nothing is known about it"
        if port.accessible:
            yield Finding(port.device, "ok", detail, "")
        else:
            # a port that is not USB is most likely built in, and not that of a bench
            yield Finding(
                port.device,
                "broken" if port.vendor is not None else "optional",
                f"{detail}; you have no permission to open it",
                port.fix,
            )


def guard_findings() -> Iterator[Finding]:
    """Guards that are still trying to make a device safe, or have given up."""
    from rigctl.backends.transport.safe_state_retries import retrying_guards

    for notice in retrying_guards():
        fix = "switch the device off by hand, at its supply; then 'rigctl off' takes this guard's place"
        yield Finding("OUTPUTS MAY BE ON", "broken", str(notice), fix)


def ports_document(ports: Sequence[PortInfo] | PortsUnlisted) -> list[dict[str, Any]]:
    """The ports for programs; field names are part of the interface."""
    from rigctl.backends.transport.serial_ports import PortsUnlisted

    if isinstance(ports, PortsUnlisted):
        return []
    return [{**asdict(port), "usb": port.usb} for port in ports]


def ask_port(url: str, baud: int) -> tuple[Finding, dict[str, Any]]:
    """Open a port, identify the device, and measure the quality of the line."""
    from rigctl.backends.lines.probe import probe
    from rigctl.backends.transport.port import PortLost
    from rigctl.backends.transport.pyserial_port import PyserialPort
    from rigctl.clock import real_clock

    clock = real_clock()
    document: dict[str, Any] = {"port": url, "baud": baud}
    try:
        device = probe(lambda: PyserialPort(url, baud, clock), clock)
    except PortLost as error:
        fix = "are the port and --baud right? Is the board flashed, and does it have power?"
        return Finding(url, "broken", str(error), fix), {**document, "error": str(error)}
    except RigctlError as error:
        return Finding(url, "broken", str(error), error.hint or ""), {**document, "error": str(error)}
    return _heard(url, device), {**document, **asdict(device)}


def ask_rig(path: Path, urls: Sequence[str]) -> tuple[list[Finding], list[dict[str, Any]]]:
    """Connect to the device of a rig file, or to each of several; read every channel once and report
    impossible values; set nothing.

    Parameters
    ----------
    urls: other addresses than those of the file; with several devices ``NAME=ADDRESS``.
    """
    from rigctl.backends.registry import options_of_device
    from rigctl.rig import DEVICES, load_rig
    from rigctl.runner.bench_access import bench_options

    rig = load_rig(path)
    if not rig.devices:
        reports = [_ask_device(path.name, rig, url) for url in urls or (None,)]
    else:
        options = bench_options(DEVICES, rig, port=urls)
        reports = []
        for name, part in rig.parts.items():
            url = options_of_device(rig, name, options).get("port")
            report = _ask_device(name, part, None if url is None else str(url))
            reports.append((_of_device(name, report[0]), {"device": name, **report[1]}))
    return (
        [finding for findings, _ in reports for finding in findings],
        [{"rig": path.as_posix(), **document} for _, document in reports],
    )


def _of_device(name: str, findings: Sequence[Finding]) -> list[Finding]:
    """The findings on one of several devices, with its name before its address."""
    return [
        replace(one, detail=f"{name}: {one.detail}") if one.subject != name and index == 0 else one
        for index, one in enumerate(findings)
    ]


def _ask_device(name: str, rig: Rig, url: str | None) -> tuple[list[Finding], dict[str, Any]]:
    """Connect to one device, as `ask_rig`; `name` stands for it until its address is known."""
    from rigctl.backends.lines.reading import read_once
    from rigctl.backends.registry import address_of
    from rigctl.backends.transport.port import PortLost
    from rigctl.clock import real_clock

    document: dict[str, Any] = {}
    try:
        if rig.kind in ("simulated", "emulated"):
            return [Finding(name, "ok", f"{rig.kind}: it exists only while it is used")], {"kind": rig.kind}
        if rig.lines is None and rig.kind != "serial":  # a plug-in whose protocol is its own
            known = f"{rig.name}: a bench of the plug-in '{rig.kind}', which is not asked anything here"
            return [Finding(name, "optional", known, "read it with 'rigctl monitor'")], {"kind": rig.kind}
        address = address_of(rig, url)
        document |= {"port": address.url}
        if rig.lines is None:
            finding, answer = ask_port(address.url, address.settings["baud"])
            return [finding], {**document, **answer}
        reading = read_once(rig, rig.lines, address, real_clock())
    except PortLost as error:
        fix = "is the address right, does the device have power, and does a firewall let it through?"
        return [Finding(name, "broken", str(error), fix)], {**document, "error": str(error)}
    except RigctlError as error:
        return [Finding(name, "broken", str(error), error.hint or "")], {**document, "error": str(error)}
    known = ", ".join(f"{key} {text}" for key, text in reading.identity.items())
    answers = f"answers in {1e3 * reading.round_trip:.1f} ms" if reading.round_trip >= 0.0 else "answers"
    findings = [Finding(address.url, "ok", f"{rig.name}: {answers}{', ' if known else ''}{known}")]
    findings += [Finding(address.url, "broken", trouble) for trouble in reading.troubles]
    findings += _channel_findings(rig, reading, address.url)
    return findings, {**document, **asdict(reading)}


def _channel_findings(rig: Rig, reading: OneReading, url: str) -> Iterator[Finding]:
    impossible = reading.impossible(rig)
    fix = _other_order(rig, impossible, url) if impossible else ""
    for name, value in reading.values.items():
        if name not in impossible:
            yield Finding(name, "ok", _shown(rig, name, value))
        elif math.isnan(value):
            yield Finding(name, "broken", "the device gives no number for it", fix)
        else:
            shown = _shown(rig, name, value)
            yield Finding(name, "broken", f"{shown}, which is outside its range", fix)


def _shown(rig: Rig, name: str, value: float) -> str:
    from rigctl.units import show

    channel = rig.channels[name]
    return show(value, channel.unit, difference=channel.difference, digits=6)


def _other_order(rig: Rig, impossible: Sequence[str], url: str) -> str:
    """The order of bytes and words that would give possible values; empty if none does."""
    from rigctl.backends.lines.reading import read_once
    from rigctl.backends.registry import address_of, other_readings
    from rigctl.backends.transport.port import PortLost
    from rigctl.clock import real_clock

    for text, other in other_readings(rig):
        if other.lines is None:
            continue
        try:
            reading = read_once(other, other.lines, address_of(other, url), real_clock())
        except (PortLost, RigctlError):
            continue
        if not reading.impossible(other):
            values = ", ".join(f"{name} {_shown(rig, name, reading.values[name])}" for name in impossible)
            return f"with '{text}' in backend.modbus it reads {values}"
    return "compare the address, type and scale with the device's manual"


def _heard(url: str, device: Found) -> Finding:
    link = device.link
    quality = (
        f"{link.answered} of {link.asked} answers whole, round trip {1e3 * link.median:.1f} ms, "
        f"at most {1e3 * link.slowest:.1f} ms"
    )
    if link.answered == link.asked:
        return Finding(url, "ok", f"{device.name}; {quality}")
    return Finding(
        url,
        "broken",
        f"{device.name}; {quality}",
        "a shorter cable, another socket, away from motors and relays",
    )


def emulator_finding() -> Finding:
    """simavr, for a board without hardware."""
    from rigctl.backends.emulated.library import load_libraries

    purpose = "the board's firmware without a board ('--backend emulated')"
    try:
        load_libraries()
    except RigctlError as error:
        return Finding("emulated board", "optional", purpose, (error.hint or "").removeprefix("Install it: "))
    return Finding("emulated board", "ok", purpose)


def rig_findings(folder: Path) -> Iterator[Finding]:
    """The rig files of a project: mistakes in them, and calibrations that are out of date."""
    from rigctl.rig import load_rig
    from rigctl.rig.checks import doubtful_calibrations

    today = datetime.now(UTC).date()
    for path in sorted(folder.glob("*.yaml")):
        try:
            rig = load_rig(path)
        except RigctlError as error:
            yield Finding(path.name, "broken", str(error).partition("\n")[0], f"edit {path.as_posix()}")
            continue
        doubts = list(doubtful_calibrations(rig, today))
        for channel, doubt in doubts:
            yield Finding(path.name, "optional", doubt, f"rigctl calibrate {channel} --rig {path.as_posix()}")
        if not doubts:
            yield Finding(path.name, "ok", f"{rig.name}: calibrations are in date")
