"""Checks across the fields of a rig file: names exist, dimensions agree, the safe state is complete.

In: a rig whose fields are each valid. Out: every `Problem`, with its place in the file, not only the
first. Checks that would only repeat a problem found before are left out: of a channel with a wrong unit
nothing else is checked, and of devices with stray channels no protocol is.

What is an error here makes the file unusable; what is doubtful but possible is a warning (`warnings`), which
`rigctl check` and `rigctl run` print.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.amount import Amount
from rigctl.rig.actuator import Actuator
from rigctl.rig.calibration import monotonic
from rigctl.rig.channel import QUANTITIES, Channel
from rigctl.rig.constants import CONSTANTS, GEOMETRY, Constant
from rigctl.rig.layout import RECORD, TIME
from rigctl.rig.problem import Problem
from rigctl.rig.protocols.client_checks import driver_problems, node_problems, register_problems
from rigctl.rig.protocols.client_lines import client_problems
from rigctl.rig.protocols.line_checks import line_problems
from rigctl.rig.rig import Rig
from rigctl.rig.stated_noise import StatedNoise
from rigctl.units import interval_unit, parse_unit

#: backends whose readings come from no sensors
_UNREAL = ("simulated", "emulated", "replay")
#: the sections that describe what a device is sent
_PROTOCOLS = ("lines", "modbus", "opcua", "python")

#: reserved names in expressions and tables
RESERVED = frozenset(
    f"{TIME} {RECORD} and or not true false abs min max sqrt exp log first last mean std duration".split()
)


def problems(rig: Rig) -> Iterator[Problem]:
    """Yield all errors that involve several parts of the file."""
    # Names first, as all else refers to them; then each part by itself, then what parts say of each other.
    yield from _names(rig)
    for name, channel in rig.channels.items():
        yield from _channel(("channels", name), channel)
    yield from _clocks(rig)
    yield from _align(rig)
    yield from _could_have(rig)
    yield from _actuators(rig)
    yield from _roles(rig)
    yield from _limits(rig)
    yield from _safe_state(rig)
    yield from _constants(rig)
    yield from _simulation(rig)
    # With several devices, each part is checked as a rig of its own, by the same checks as the one device of
    # another.
    if rig.devices:
        yield from _devices(rig)
    else:
        yield from _devices_without(rig)
        yield from _protocol(rig)
        yield from _rates(rig)


def _protocol(rig: Rig) -> Iterator[Problem]:
    """Check the protocol of the one device of a rig, or of a part of it."""
    # One protocol at most; what it describes, in its own module; and last that a kind of device that needs
    # one has it.
    device = rig.backend
    spoken = [name for name in _PROTOCOLS if getattr(device, name) is not None]
    if len(spoken) > 1:
        error = RigctlError("a device has one protocol", value=", ".join(spoken))
        yield Problem(("backend", spoken[-1]), error, of_key=True)
    if device.lines is not None:
        yield from line_problems(rig, device.lines)
    if device.modbus is not None:
        yield from register_problems(device.modbus, rig.channels, rig.actuators, rig.safe_state)
    if device.opcua is not None:
        yield from node_problems(device.opcua, rig.channels, rig.actuators)
    if device.python is not None:
        yield from driver_problems(device.python, rig.channels, rig.actuators)
    if device.plugin is not None:
        written = {name: one.values for name, one in device.plugin.actuators.items()}
        at = ("backend", "options")
        yield from client_problems(rig.channels, rig.actuators, at, device.plugin.channels, written)
    for kind, field, what in (
        ("modbus", "modbus", "where its registers are"),
        ("opcua", "opcua", "where its nodes are"),
        ("python", "python", "which driver it has"),
        ("visa", "lines", "what the instrument is sent"),
    ):
        if device.kind == kind and getattr(device, field) is None:
            error = RigctlError(f"nothing says {what}", expected=f"'{field}:'")
            yield Problem(("backend",), error)


def _devices_without(rig: Rig) -> Iterator[Problem]:
    """Refuse the names of devices in a rig that names none."""
    for section, parts in (("channels", rig.channels), ("actuators", rig.actuators)):
        for name, part in parts.items():
            if part.device is not None:
                error = RigctlError(
                    "the rig names no devices", value=part.device, expected=f"'devices: {{{part.device}: …}}'"
                )
                yield Problem((section, name, "device"), error)


def _devices(rig: Rig) -> Iterator[Problem]:
    """Check the devices of a bench that has several."""
    # What the loss of each means and where each is; then what belongs to it, and only then how that is
    # read.
    if rig.backend.model_fields_set:
        error = RigctlError("a rig has one backend or several devices", value="both", expected="one of them")
        yield Problem(("backend",), error, of_key=True)
    yield from _lost(rig)
    yield from _addresses(rig)
    strays = list(_members(rig))
    yield from strays
    if not strays:  # otherwise it is not known what the protocols have to describe
        yield from _protocols(rig)


def _lost(rig: Rig) -> Iterator[Problem]:
    """Refuse to go on without a device on which the safety of the bench depends, or to wait in vain."""
    for name, device in rig.devices.items():
        if "back_within" in device.model_fields_set and device.lost != "pause":
            error = RigctlError(f"back_within: a run only waits with 'lost: pause', not '{device.lost}'")
            yield Problem(("devices", name, "back_within"), error, of_key=True)
        if device.lost != "continue":
            continue
        # What the safety of the bench rests on: a limit that nobody could check, an output that nobody could
        # make safe.
        reasons = [
            f"limit '{limit}' needs {part}"
            for limit, one in rig.limits.items()
            for part in (one.channel, one.while_on)
            if part is not None and rig.device_of(part) == name
        ]
        reasons += [
            f"safe_state needs {output}" for output in rig.safe_state if rig.device_of(output) == name
        ]
        if reasons:
            error = RigctlError(
                f"lost: a run cannot go on without '{name}': {', '.join(reasons)}",
                value="continue",
                expected="stop or pause",
            )
            yield Problem(("devices", name, "lost"), error)


def _members(rig: Rig) -> Iterator[Problem]:
    """Check that each channel and driven actuator belongs to a device."""
    for section, parts in (("channels", rig.channels), ("actuators", rig.actuators)):
        for name, part in parts.items():
            if part.device is not None:
                yield from _known(rig.devices, "device", part.device, (section, name, "device"))
            elif not (isinstance(part, Actuator) and part.by == "operator"):
                first, *_ = rig.devices
                example = f"'device: {first}', say"
                error = RigctlError(f"nothing says which device '{name}' belongs to", expected=example)
                yield Problem((section, name), error, of_key=True)


def _addresses(rig: Rig) -> Iterator[Problem]:
    """Check that no two devices have one address; several units may be behind one Modbus gateway."""
    ports: dict[str, list[tuple[str, int | None]]] = {}
    for name, device in rig.devices.items():
        if device.port is None:
            continue
        unit = None if device.modbus is None else device.modbus.unit
        others = ports.setdefault(device.port.strip().casefold(), [])
        for other, behind in others:
            # Two units at one address are two devices; a unit that is not stated may be either.
            if unit is None or behind is None or unit == behind:
                error = RigctlError(f"'{other}' is at this address already", value=device.port)
                yield Problem(("devices", name, "port"), error)
        others.append((name, unit))


def _protocols(rig: Rig) -> Iterator[Problem]:
    """Check each device's protocol, and that something belongs to it."""
    for name, part in rig.parts.items():
        keys = ("devices", name)
        if not (part.channels or part.actuators):
            error = RigctlError("no channel and no actuator belongs to this device", value=name)
            yield Problem(keys, error, of_key=True)
            continue
        for problem in _protocol(part):
            at = problem.keys
            yield replace(problem, keys=(*keys, *at[1:])) if at[0] == "backend" else problem


def _rates(rig: Rig) -> Iterator[Problem]:
    """Check that the device supports the sampling rates outside records."""
    moving = any(part.kind == "directional_valve" and part.by == "driven" for part in rig.actuators.values())
    part = next((name for name in _PROTOCOLS if getattr(rig.backend, name) is not None), "")
    part = part or ("options" if rig.backend.plugin is not None else "")
    for name in ("monitor_rate", "moving_rate") if moving else ("monitor_rate",):
        rate = getattr(rig, name)
        if rate > rig.fastest:
            error = RigctlError(
                f"{name}: more than the device can be asked for",
                value=f"{rate:g} Hz",
                expected=f"at most {rig.fastest:g} Hz" + f", as backend.{part}.fastest says" * bool(part),
            )
            yield Problem((name,), error)


def _refused(keys: tuple[str | int, ...], check: Callable[[], object]) -> Iterator[Problem]:
    try:
        check()
    except RigctlError as error:
        field = next((str(key) for key in reversed(keys) if isinstance(key, str)), "")
        error.what = f"{field}: {error.what}"
        yield Problem(keys, error)


def _amount(
    keys: tuple[str | int, ...], amount: Amount | None, unit: str, *, difference: bool = False
) -> Iterator[Problem]:
    if amount is not None:
        yield from _refused(keys, lambda: amount.check(unit, difference=difference))


def _rate(keys: tuple[str | int, ...], amount: Amount | None, unit: str) -> Iterator[Problem]:
    """Check a change per second of something that is shown in `unit`; of degC, that is K/s."""
    if amount is not None:
        per_second = f"{interval_unit(unit) or '1'}/s"
        example = f"a change per second, e.g. '5 {per_second}'"
        yield from _refused(keys, lambda: amount.check(per_second, difference=True, expected=example))


def _reading(keys: tuple[str | int, ...], amount: Amount, channel: Channel) -> Iterator[Problem]:
    """Check an amount that is compared with readings of a channel: 5 degC is no temperature difference."""
    yield from _amount(keys, amount, channel.unit)
    if channel.difference and amount.unit.offset:
        error = RigctlError(
            "the channel is a temperature difference", value=amount.text, expected="kelvin, e.g. '5 K'"
        )
        yield Problem(keys, error)


def _names(rig: Rig) -> Iterator[Problem]:
    for part, names in (("channels", rig.channels), ("actuators", rig.actuators)):
        for name in names:
            if name in RESERVED:
                error = RigctlError("this name has a meaning of its own", value=name, expected="another name")
                yield Problem((part, name), error, of_key=True)
    for name in rig.actuators:
        if name in rig.channels:
            error = RigctlError("a channel and an actuator have the same name", value=name)
            yield Problem(("actuators", name), error, of_key=True)


def _channel(keys: tuple[str | int, ...], channel: Channel) -> Iterator[Problem]:
    wanted = QUANTITIES[channel.quantity]
    # The unit first: range, noise and calibration are read in it, and would all be wrong with it.
    bad_unit = list(_refused((*keys, "unit"), lambda: parse_unit(channel.unit)))
    if bad_unit:
        yield from bad_unit
        return
    if wanted and parse_unit(channel.unit).dimension != parse_unit(wanted).dimension:
        error = RigctlError(
            f"unit: this is no unit of {channel.quantity}",
            value=channel.unit,
            expected=f"a unit like {wanted}",
        )
        yield Problem((*keys, "unit"), error)
        return
    yield from _noise(keys, channel)
    yield from _uncertainties((*keys, "calibration"), channel)
    for index, end in enumerate(channel.range or ()):
        yield from _reading((*keys, "range", index), end, channel)
    if channel.range and channel.range[0] >= channel.range[1]:
        yield Problem((*keys, "range"), RigctlError("range: the lower end is not below the upper one"))
    yield from _converter(keys, channel)


def _uncertainties(keys: tuple[str | int, ...], channel: Channel) -> Iterator[Problem]:
    """Check the units of a calibration's uncertainties, and that each is possible."""
    calibration = channel.calibration
    relative = ["gain", *(["uncertainty"] if channel.states_share_of_range else [])]
    for field in ("uncertainty", "zero", "gain", "linearity"):
        amount: Amount | None = getattr(calibration, field)
        if amount is None:
            continue
        where = (*keys, field)
        unit = "%" if field in relative else channel.unit
        wrong = list(_amount(where, amount, unit, difference=True))
        yield from wrong
        if wrong:
            continue
        if not amount >= 0.0:
            yield Problem(where, RigctlError(f"{field}: no uncertainty is negative", value=amount.text))
        elif field == "uncertainty" and field in relative and channel.range is None:
            error = RigctlError(
                "uncertainty: a percentage is one of the channel's range, and it has none",
                value=amount.text,
                expected=f"'range' too, or a number of {channel.interval_unit or '1'}",
            )
            yield Problem(where, error)
        elif field not in relative and 0.0 < channel.width < amount:
            error = RigctlError(
                f"{field}: more than the whole range", value=amount.text, expected="less than the range"
            )
            yield Problem(where, error)


def _noise(keys: tuple[str | int, ...], channel: Channel) -> Iterator[Problem]:
    """Its unit, and that it is more than nothing: a converter alone has a noise."""
    noise = channel.noise
    parts = {"white": noise.white, "slow": noise.slow} if isinstance(noise, StatedNoise) else {"": noise}
    for part, amount in parts.items():
        where = (*keys, "noise", part) if part else (*keys, "noise")
        yield from _amount(where, amount, channel.unit, difference=True)
        if amount is not None and not amount > 0.0:
            error = RigctlError(
                "noise: no reading is without noise", value=amount.text, expected="more than 0, or no entry"
            )
            yield Problem(where, error)


def _clocks(rig: Rig) -> Iterator[Problem]:
    """Check that each clock dates channels, and each channel has one clock at most."""
    dated: dict[str, str] = {}
    for name, clock in rig.clocks.items():
        for index, channel in enumerate(clock.channels):
            keys = ("clocks", name, "channels", index)
            if channel in rig.actuators:
                error = RigctlError(
                    "a command has no clock of its own: offsets count against the times of the commands",
                    value=channel,
                    expected="channels",
                )
                yield Problem(keys, error)
            elif channel in dated:
                twice = "named twice" if dated[channel] == name else f"dated by '{dated[channel]}' already"
                yield Problem(
                    keys, RigctlError(f"the channel is {twice}", value=channel, expected="one clock")
                )
            else:
                yield from _known(rig.channels, "channel", channel, keys)
            dated.setdefault(channel, name)


def _align(rig: Rig) -> Iterator[Problem]:
    """Check that the edge is one of a driven output, and that one channel of each device sees it."""
    stated = rig.align
    if stated is None:
        return
    if not rig.devices:
        yield Problem(("align",), RigctlError("a bench with one device has nothing to align"), of_key=True)
        return
    yield from _known(rig.actuators, "actuator", stated.actuator, ("align", "actuator"))
    actuator = rig.actuators.get(stated.actuator)
    if actuator is not None:
        yield from _edge(rig, actuator)
    seen: dict[str, str] = {}
    for index, channel in enumerate(stated.channels):
        keys = ("align", "channels", index)
        yield from _known(rig.channels, "channel", channel, keys)
        device = rig.device_of(channel)
        if channel in rig.channels and device in seen:
            error = RigctlError(
                f"{seen[device]} is of the same device", value=channel, expected=f"one channel of {device}"
            )
            yield Problem(keys, error)
        seen.setdefault(device, channel)


def _edge(rig: Rig, actuator: Actuator) -> Iterator[Problem]:
    """Check that the output of `align` jumps when it is commanded."""
    assert rig.align is not None  # noqa: S101 - the caller has one
    name, written = rig.align.actuator, rig.align.to.text
    if actuator.by == "operator" or actuator.max_rate is not None:
        why = "is set by hand" if actuator.by == "operator" else "has a max_rate"
        error = RigctlError(f"this output {why}, and makes no edge", value=name, expected="one that jumps")
        yield Problem(("align", "actuator"), error)
    try:
        value = actuator.read(written)
    except RigctlError as wrong:
        yield Problem(("align", "to"), wrong)
        return
    if name in rig.safe_state and value == float(rig.safe_state[name]):
        error = RigctlError("this is its safe state", value=written, expected="another setting")
        yield Problem(("align", "to"), error)


def _could_have(rig: Rig) -> Iterator[Problem]:
    for name, possible in rig.could_have.items():
        keys = ("could_have", name)
        if name in rig.channels or name in rig.actuators or name in RESERVED:
            what = (
                "the bench has this name already"
                if name not in RESERVED
                else "this name has a meaning of its own"
            )
            yield Problem(keys, RigctlError(what, value=name, expected="another name"), of_key=True)
        yield from _channel(keys, possible.channel)
        if not possible.noise > 0.0:
            error = RigctlError("noise: a sensor without any tells everything", expected="more than 0")
            yield Problem((*keys, "noise"), error)
    currencies = {one.price.currency for one in rig.could_have.values() if one.price is not None}
    if len(currencies) > 1:
        error = RigctlError(
            "prices in several currencies", value=", ".join(sorted(currencies)), expected="one"
        )
        yield Problem(("could_have",), error)


def _converter(keys: tuple[str | int, ...], channel: Channel) -> Iterator[Problem]:
    raw = channel.raw
    coefficients = channel.calibration.coefficients
    if raw is None:
        yield from _without_converter((*keys, "calibration", "coefficients"), coefficients)
    elif raw.low >= raw.high:
        yield Problem((*keys, "raw"), RigctlError("raw: 'low' is not below 'high'"))
    elif not monotonic(coefficients, raw.low, raw.high):
        error = RigctlError(
            "coefficients: two raw values give the same reading",
            expected="a polynomial that only rises or only falls over the raw range",
        )
        yield Problem((*keys, "calibration", "coefficients"), error)


def _without_converter(keys: tuple[str | int, ...], coefficients: Sequence[float]) -> Iterator[Problem]:
    if any(coefficients[2:]):
        error = RigctlError(
            "coefficients: a curved calibration needs the range of its converter",
            expected="'raw: {bits: 12, low: 0, high: 4095}', say, with the channel",
        )
        yield Problem(keys, error)
    elif coefficients[1] == 0.0:
        yield Problem(keys, RigctlError("coefficients: two raw values give the same reading"))


def _actuators(rig: Rig) -> Iterator[Problem]:
    for name, actuator in rig.actuators.items():
        keys = ("actuators", name)
        if actuator.kind == "level":
            if actuator.unit is None:
                yield Problem(keys, RigctlError("a level needs a unit", value=name, expected="'unit: bar'"))
                continue
            unit = actuator.unit
            bad_unit = list(_refused((*keys, "unit"), lambda unit=unit: parse_unit(unit)))  # type: ignore[misc]
            yield from bad_unit
            if not bad_unit:
                yield from _amount((*keys, "low"), actuator.low, unit)
                yield from _amount((*keys, "high"), actuator.high, unit)
                yield from _rate((*keys, "max_rate"), actuator.max_rate, unit)
                if actuator.max_rate is not None and not actuator.max_rate > 0.0:
                    error = RigctlError("max_rate: nothing could move", expected="more than 0")
                    yield Problem((*keys, "max_rate"), error)
        else:
            for field in ("unit", "low", "high", "max_rate"):
                if getattr(actuator, field) is not None:
                    error = RigctlError(f"a {actuator.kind} has no '{field}'", expected="kind: level")
                    yield Problem((*keys, field), error, of_key=True)


def _roles(rig: Rig) -> Iterator[Problem]:
    for role in ("heat", "set_pressure", "extend", "retract"):
        part = getattr(rig.roles, role)
        if part is None:
            continue
        keys = ("roles", role)
        yield from _known(rig.actuators, "actuator", part.actuator, (*keys, "actuator"))
        reader = "position" if role in ("extend", "retract") else "channel"
        if getattr(part, reader) is not None:
            yield from _known(rig.channels, "channel", getattr(part, reader), (*keys, reader))
    if rig.roles.heat is not None and rig.roles.heat.hysteresis is not None:
        yield from _amount(("roles", "heat", "hysteresis"), rig.roles.heat.hysteresis, "K", difference=True)
    for role in ("extend", "retract"):
        part = getattr(rig.roles, role)
        if part is not None and part.actuator in rig.actuators:
            actuator = rig.actuators[part.actuator]
            yield from _refused(("roles", role, "value"), lambda a=actuator, p=part: a.read(p.value.text))  # type: ignore[misc]


def _known(
    names: Mapping[str, object], kind: str, name: str, keys: tuple[str | int, ...]
) -> Iterator[Problem]:
    if name not in names:
        yield Problem(keys, unknown_name(kind, name, names))


def _limits(rig: Rig) -> Iterator[Problem]:
    for name, limit in rig.limits.items():
        keys = ("limits", name)
        # The bound is read in the unit of the channel, which must exist; `unchanged` has no bound.
        if limit.channel not in rig.channels:
            yield from _known(rig.channels, "channel", limit.channel, (*keys, "channel"))
            continue
        if limit.bound == "unchanged":
            if limit.while_on is not None:
                yield from _known(rig.actuators, "actuator", limit.while_on, (*keys, "while_on"))
            continue
        unit = rig.channels[limit.channel].unit
        bound: Amount = getattr(limit, limit.bound)
        if not limit.of_rate:
            yield from _reading((*keys, limit.bound), bound, rig.channels[limit.channel])
            continue
        yield from _rate((*keys, limit.bound), bound, unit)


def _safe_state(rig: Rig) -> Iterator[Problem]:
    # Both ways: nothing in it is unknown, and no driven output is missing, since that one would stay on.
    for name, value in rig.safe_state.items():
        if name not in rig.actuators:
            yield Problem(("safe_state", name), unknown_name("actuator", name, rig.actuators), of_key=True)
            continue
        yield from _refused(("safe_state", name), lambda n=name, v=value: rig.actuators[n].read(v.text))  # type: ignore[misc]
    for name, actuator in rig.actuators.items():
        if actuator.by == "driven" and name not in rig.safe_state:
            error = RigctlError(
                f"safe_state does not say where '{name}' goes", expected="every driven actuator"
            )
            yield Problem(("safe_state",), error)


def _constants(rig: Rig) -> Iterator[Problem]:
    for part, given, known in (
        ("geometry", rig.geometry, GEOMETRY.get(rig.model or "")),
        ("constants", rig.constants, CONSTANTS.get(rig.model or "")),
    ):
        if known is not None:
            for name, amount in given.items():
                yield from _constant((part, name), name, amount, known)


def _constant(
    keys: tuple[str, str], name: str, amount: Amount, known: Mapping[str, Constant]
) -> Iterator[Problem]:
    if name not in known:
        yield Problem(keys, unknown_name(f"name in {keys[0]}", name, known), of_key=True)
    else:
        yield from _amount(keys, amount, known[name].unit)


def _simulation(rig: Rig) -> Iterator[Problem]:
    for name, amount in rig.simulation.initial.items():
        keys = ("simulation", "initial", name)
        if name not in rig.channels:
            yield Problem(keys, unknown_name("channel", name, rig.channels), of_key=True)
        else:
            yield from _reading(keys, amount, rig.channels[name])
    for name in rig.simulation.scatter:
        if name not in rig.actuators:
            error = unknown_name("actuator", name, rig.actuators)
            yield Problem(("simulation", "scatter", name), error, of_key=True)


def warnings(rig: Rig, today: date) -> Iterator[str]:
    """Yield the warnings before a run."""
    # Each is one sentence; with several devices, that on one of them begins with its name.
    for _, doubt in doubtful_calibrations(rig, today):
        yield doubt
    if not any(limit.action == "stop" for limit in rig.limits.values()):
        yield "no limit stops a run: the rig file has no interlock"
    without = [name for name, one in rig.channels.items() if one.range is None]
    if without and any(part.kind not in _UNREAL for part in rig.parts.values()):
        yield (
            f"{', '.join(without)}: without a 'range' a broken wire or a garbled number counts as a reading: "
            "it says what the sensor can measure, e.g. range: [-40 degC, 150 degC]"
        )
    for name, part in rig.parts.items():
        for warning in (*_without_watchdog(part), *_read_back(part)):
            yield f"{name}: {warning}" if name else warning
    yield from _exact(rig)


def _without_watchdog(rig: Rig) -> Iterator[str]:
    """Warn of outputs that stay on if this computer dies."""
    lines, driven = rig.lines, [n for n, part in rig.actuators.items() if part.by == "driven"]
    if lines is not None and driven and lines.keep_alive is None:
        yield (
            f"the device has no watchdog of its own: {', '.join(driven)} would stay on if this computer "
            "dies; its guard, a process on this computer, acts when rigctl alone does"
        )


def _exact(rig: Rig) -> Iterator[str]:
    """Warn of channels without a stated uncertainty: no sensor is exact, and analyses assume that it is."""
    parts = ("uncertainty", "zero", "gain", "linearity")
    exact = [
        name
        for name, channel in rig.channels.items()
        if all(getattr(channel.calibration, part) is None for part in parts)
    ]
    if exact:
        yield (
            f"no uncertainty is stated for {', '.join(exact)}: analyses take the readings as exact but for "
            "their noise; 'uncertainty: 1 K' in a calibration says how far it may be wrong"
        )


def _unread(rig: Rig) -> list[str]:
    """Return the driven outputs whose state no query reads back."""
    if rig.lines is None:
        return []
    read = {place for query in rig.lines.queries for place in query.places}
    return [name for name, part in rig.actuators.items() if part.by == "driven" and name not in read]


def _read_back(rig: Rig) -> Iterator[str]:
    """Warn of outputs whose safe state can only be acknowledged, and of those not even acknowledged."""
    unread = _unread(rig)
    if rig.lines is None or not unread:
        return
    asked, parts = rig.lines.confirm is not None, rig.lines.actuators
    answered = [name for name in unread if asked or parts[name].patterns]
    would_show = f"a query with '{{{unread[0]}}}' in its answer would show it"
    yield (
        f"nothing reads {', '.join(unread)} back: a restart of the device, or another program's command, "
        f"may go unnoticed; {would_show}"
    )
    if answered:
        yield (
            f"the device only acknowledges commands to {', '.join(answered)}: at the end of a run its word "
            "that they are off is all that rigctl has"
        )
    if silent := [name for name in unread if name not in answered]:
        yield (
            f"the device neither reports {', '.join(silent)} nor answers their commands: every run that "
            "drives them to a value that is not safe ends as failed, with outputs not confirmed safe"
        )


def doubtful_calibrations(rig: Rig, today: date) -> Iterator[tuple[str, str]]:
    """Yield the channels whose calibration has no date or is out of date, each with a sentence about it."""
    for name, channel in rig.channels.items():
        calibration = channel.calibration
        expires = calibration.expires()
        if calibration.date is None:
            yield name, f"channel '{name}' has no calibration date"
        elif calibration.date > today:
            when = calibration.date
            yield name, f"channel '{name}': its calibration is dated {when}, which is still to come"
        elif expires is not None and expires <= today:
            yield name, f"channel '{name}': its calibration of {calibration.date} ran out on {expires}"
