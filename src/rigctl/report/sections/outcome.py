"""What was run, on which bench, when and by whom, and how it ended in one sentence.

In: the `RunData` of one or several runs. Out: the first section of a page, unless an analysis comes
before it. It is made of what `run.json` and the records say.

Whether the outputs are known to be safe is stated apart from how the run ended. A finished run with an
output in doubt is shown as bad, and a run that was killed never as safe, even if nothing was in doubt
when it was last heard of: whoever reads this may be about to touch the bench.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigctl.answers.numbers import duration, moment, plural, whole
from rigctl.dataset.history import absences_in
from rigctl.report.run_data import COMPLETE, RunData
from rigctl.report.section import Section, render
from rigctl.report.signals import ALARMS, end_to_end

#: kinds of bench whose numbers come from equations
_SIMULATED = {"simulated": "simulated bench", "emulated": "emulated board and simulated bench"}
#: ``procedures/stroke.yaml:15:5: what happened``
_PLACE = re.compile(r"(?:.*[/\\])?(?P<file>[^/\\:]+\.ya?ml):(?P<line>\d+)(?::\d+)?: (?P<what>.+)", re.DOTALL)
#: the results for the device under test, if a measure has limits
_RESULTS = {"pass": "passed", "fail": "failed", "incomplete": "incomplete"}
_STATUS = {
    "finished": ("good", "finished"),
    "failed": ("bad", "failed"),
    "aborted": ("warn", "aborted"),
    "interrupted": ("warn", "interrupted"),
    "running": ("warn", "in progress"),
}


@dataclass(frozen=True)
class RunSummary:
    """The summary of one run at the top of the page."""

    id: str
    tone: str  #: good, warn or bad
    status: str
    badge: str | None  #: a notice that no real bench was involved
    statement: str
    safety: str  #: for a run that ended early: whether its outputs are known to be safe
    safe: bool
    figures: tuple[tuple[str, str], ...]
    facts: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def build(runs: Sequence[RunData]) -> Section:
    """A summary of each run."""
    body = render("outcome.html", summaries=[summarise(run) for run in runs])
    several = len(runs) > 1
    title = "Outcome" if all(map(ended_well, runs)) else "What happened"
    hint = plural(len(runs), "run") if several else statement(runs[0])
    return Section("outcome", title, body, hint=hint)


def ended_well(run: RunData) -> bool:
    """Whether a run was completed, with every output known to be safe."""
    return run.info.get("status") == "finished" and not run.info.get("unconfirmed")


def summarise(run: RunData) -> RunSummary:
    """The complete summary of a run."""
    status = str(run.info.get("status", ""))
    imported = run.info.get("source") == "import"
    tone, word = _STATUS.get(status, ("warn", status or "unknown"))
    missed = sum(not measured.passed for measured in run.all_measures())
    if missed and tone == "good":
        tone = "warn"
    if _part(run.info, "test").get("result") == "fail":
        tone = "bad"
    if run.info.get("unconfirmed"):  # the state of the outputs is unknown: the bench has to be inspected
        tone = "bad"
    kind = str(_part(run.info, "backend").get("kind", ""))
    return RunSummary(
        id=run.id,
        tone=tone,
        status="imported" if imported and tone == "good" else word,
        badge=_SIMULATED.get(kind),
        statement=statement(run),
        safety=safety(run),
        safe=_known_safe(run),
        figures=tuple(_figures(run, missed)),
        facts=tuple((name, value) for name, value in _facts(run) if value),
        notes=tuple(_notes(run)),
    )


def statement(run: RunData) -> str:
    """How a run ended, in a sentence or two."""
    status = str(run.info.get("status", ""))
    if status == "finished":
        began = "The data was imported" if run.info.get("source") == "import" else "The run finished"
        return f"{began}. {_kept(run)}{_measured(run)}."
    verb = {"failed": "failed", "aborted": "was aborted", "running": "is in progress"}.get(
        status, "was interrupted"
    )
    reason = readable(str(run.info.get("reason") or ""))
    return f"The run {verb}{': ' + reason if reason else ''}. {_kept_so_far(run)}{_measured(run)}."


def safety(run: RunData) -> str:
    """The known state of the outputs after a run that ended early; "" for a completed run."""
    doubt = run.info.get("unconfirmed")
    if doubt:
        return f"Not confirmed safe: {doubt} may still be on. Look at the bench before you touch it."
    if ended_well(run) or run.info.get("status") == "running" or run.info.get("source") == "import":
        return ""
    if _known_safe(run):
        return "Safe: every output was put into its safe state at the end, and the bench confirmed it."
    return "The final state of the outputs was not recorded: look at the bench before you touch it."


def _known_safe(run: RunData) -> bool:
    """Whether the run was ended by rigctl itself, and no output was in doubt."""
    ended = run.info.get("status") in ("finished", "failed", "aborted")
    return ended and "unconfirmed" in run.info and not run.info["unconfirmed"]


def readable(reason: str) -> str:
    """A reason with its location in a file moved to the end."""
    match = _PLACE.match(reason)
    if match is None:
        return reason.rstrip(".")
    return f"{match['what'].rstrip('.')} ({match['file']}, line {match['line']})"


def _complete(run: RunData) -> int:
    return sum(record.outcome == COMPLETE for record in run.records)


def _kept(run: RunData) -> str:
    """The number of records of a completed run."""
    complete, total = _complete(run), len(run.records)
    if total == 0:
        return "Nothing was recorded"
    if complete == total:
        return "The record is complete" if total == 1 else f"All {total} records are complete"
    return f"{complete} of {plural(total, 'record')} {'is' if complete == 1 else 'are'} complete"


def _kept_so_far(run: RunData) -> str:
    """The number of records of a run that ended early."""
    complete, total = _complete(run), len(run.records)
    if total == 0:
        return "Nothing was recorded"
    if complete == total:
        return f"{plural(complete, 'record')} {'was' if complete == 1 else 'were'} complete by then"
    return f"{complete} of {plural(total, 'record')} {'was' if complete == 1 else 'were'} complete by then"


def _measured(run: RunData) -> str:
    """The results of the values with limits."""
    limited = [measured for measured in run.all_measures() if measured.limited]
    missed = sum(not measured.passed for measured in limited)
    if not limited:
        return ""
    if missed == 0:
        return ", and every measured value lies within its limits"
    return f", and {missed} of {plural(len(limited), 'measured value')} " + (
        "lies outside its limits" if missed == 1 else "lie outside their limits"
    )


def _figures(run: RunData, missed: int) -> list[tuple[str, str]]:
    """The key figures of a run."""
    complete, total = _complete(run), len(run.records)
    open_ended = run.info.get("status") != "finished" and complete == total
    figures = [("records complete", str(complete) if open_ended else f"{complete} of {total}")]
    timed = bool(len(run.time)) or not total  # the rows of a table are not time series
    if timed:
        figures += [("duration", duration(_length(run))), ("samples", whole(len(run.time)))]
    excluded = sum(record.excluded is not None for record in run.records)
    if excluded:
        figures.append(("records excluded", str(excluded)))
    limited = sum(measured.limited for measured in run.all_measures())
    if limited:
        figures.append(("values within limits", f"{limited - missed} of {limited}"))
    alarms = sum(event.kind in ALARMS for event in run.events)
    if timed or alarms:
        figures.append(("alarms and faults", str(alarms) if alarms else "none"))
    return figures


def _length(run: RunData) -> float:
    time, shift = end_to_end(run)
    if shift.any():  # each record of a logger that restarts its clock
        return float(time[-1] - time[0])
    given = run.info.get("duration")
    if isinstance(given, int | float):
        return float(given)
    return float(run.time[-1] - run.time[0]) if len(run.time) else 0.0


def _identities(backend: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The bench, without a name, and each of its devices where it has several: kind, then what is known."""
    parts: dict[str, dict[str, str]] = {"": {}}
    for key, value in backend.items():
        device, _, name = key.rpartition(".")
        parts.setdefault(device, {})[name] = str(value)
    found = []
    for device, facts in parts.items():
        known = [key for key in facts if key not in ("kind", "seed")]
        identity = ", ".join(f"{key.replace('_', ' ')} {facts[key]}" for key in known)
        words = (facts.get("kind", ""), identity)
        found.append((device, " · ".join(word for word in words if word)))
    return found


def _facts(run: RunData) -> list[tuple[str, str]]:
    info = run.info
    backend = _part(info, "backend")
    arguments = ", ".join(f"{name} = {value}" for name, value in _part(info, "arguments").items())
    whole, *devices = _identities(backend)
    seed = info.get("seed")
    sessions = len(info.get("sessions") or ())
    return [
        ("Procedure", str(_part(info, "procedure").get("name", ""))),
        ("Arguments", arguments),
        ("Rig", str(_part(info, "rig").get("name", ""))),
        ("Bench", whole[1]),
        *((f"Device {name}", identity) for name, identity in devices),
        ("Lost devices", absences_in(info)),
        ("Test", _test(info)),
        ("Serial number", str(_part(info, "device").get("serial_number", ""))),
        ("Part", str(_part(info, "device").get("part", ""))),
        ("Notes on the device", str(_part(info, "device").get("notes", ""))),
        ("Operator", str(info.get("operator") or "")),
        ("Started", moment(info.get("started"))),
        ("Ended", moment(info.get("ended"))),
        ("Clock", str(info.get("clock") or "")),
        ("Seed", "" if seed is None else str(seed)),
        ("Sessions", f"{sessions}, resumed {plural(sessions - 1, 'time')}" if sessions > 1 else ""),
        ("rigctl", str(_part(info, "versions").get("rigctl", ""))),
    ]


def _test(info: Mapping[str, Any]) -> str:
    """The result for the device under test; "" if no measure has limits."""
    test = _part(info, "test")
    return _RESULTS.get(str(test.get("result")), "") if test.get("passed") or test.get("missed") else ""


def _notes(run: RunData) -> list[str]:
    """Notes that people added to the run afterwards."""
    notes = [item for item in run.info.get("annotations") or () if item.get("kind") == "note"]
    return [
        f"{item.get('text', '')} ({', '.join(filter(None, (item.get('by'), moment(item.get('when')))))})"
        + (f", record {item['record']}" if item.get("record") is not None else "")
        for item in notes
    ]


def _part(info: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = info.get(name)
    return part if isinstance(part, Mapping) else {}
