"""A damaged or forged run among others is one row of every list, and no command ends without a message."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from commands import call
from dataset.conftest import RunMaker
from dataset.forgery import sealed
from rigctl.dataset import list_runs
from rigctl.dataset.catalogue import page_of_runs
from rigctl.errors import RigctlError
from rigctl.project import Project
from rigctl.web.jobs import Jobs
from rigctl.web.request_handling import PageRequest
from rigctl.web.runs import Catalogue
from rigctl.web.server_state import Site

FORGED = "20261122-000000-forged"
Damage = Callable[[Path], None]


def stated(**changes: object) -> Damage:
    """Fields of run.json, "a__b" for b in a, with a valid checksum."""

    def damage(folder: Path) -> None:
        info = json.loads((folder / "run.json").read_text("utf-8"))
        for name, value in changes.items():
            *parents, last = name.split("__")
            inner: dict[str, Any] = info
            for parent in parents:
                inner = inner[parent]
            inner[last] = value
        (folder / "run.json").write_text(sealed(info), "utf-8")

    return damage


def written(name: str, content: bytes, *, without: str | None = None) -> Damage:
    def damage(folder: Path) -> None:
        if without is not None:
            (folder / without).unlink()
        (folder / name).write_bytes(content)

    return damage


def unsealed(**changes: object) -> Damage:
    """Fields of run.json, without the checksum that belongs to them."""

    def damage(folder: Path) -> None:
        info = json.loads((folder / "run.json").read_text("utf-8")) | changes
        (folder / "run.json").write_text(json.dumps(info), "utf-8")

    return damage


def linked(name: str, target: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).symlink_to(target)

    return damage


def pipe(name: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)

    return damage


def table(name: str, columns: dict[str, Any]) -> Damage:
    return lambda folder: pq.write_table(pa.table(columns), folder / name)


def event(data: str, kind: str = "command") -> Damage:
    row = {"time": 0.0, "kind": kind, "record": 0, "path": "", "message": "", "data": data}
    return table("events.parquet", {name: [value] for name, value in row.items()})


DAMAGES: dict[str, Damage] = {
    **{f"format {value!r}": stated(format=value) for value in ("2", None, [], 9, 0, True, 1.5)},
    **{f"unsealed {value!r}": unsealed(format=value, operator="Eve") for value in ("2", 0, -1, True, 1, 1.0)},
    "nested": written("run.json", b"[" * 200_000),
    "nested objects": written("run.json", b'{"a":' * 100_000),
    "long number": written("run.json", b'{"id":"x","status":"finished","rows":' + b"9" * 5000 + b"}"),
    "nested log": written("log.jsonl", b"[" * 300_000 + b"\n", without="run.json"),
    "no line": written("log.jsonl", b"\n", without="run.json"),
    **{f"rows {value}": stated(rows=value) for value in (10**30, -(10**30), True, 1.5, None)},
    **{f"records {value}": stated(records=value, complete_records=value) for value in (10**10, True, "3")},
    **{f"seed {value!r}": stated(seed=value) for value in (10**30, "7", 0.5)},
    **{f"duration {value}": stated(duration=value) for value in (1e308, -1e9, True, float("nan"), 10**400)},
    **{
        f"started {value!r}": stated(started=value)
        for value in ("yesterday", "2026-11-21T09:30:00", "0001-01-01T00:00:00+14:00", "", 7)
    },
    "half a character in started": stated(started="\ud800"),
    "half a character in a name": stated(procedure__name="\udfff"),
    "half a character in a key": stated(backend={"\ud800": "x"}),
    "status": stated(status="exploded"),
    "control characters": stated(status="fin\x1b[2J\x1b[31mished", operator="\x1b]0;owned\x07\x1b[8m hidden"),
    "operator": stated(operator={"a": 1}),
    "right to left": stated(procedure__name="\u202egnp.exe"),
    "measures": stated(measures=[1, None, "x", {"name": []}]),
    "annotations": stated(annotations=[1, None]),
    "strange annotation": stated(annotations=[{"when": "", "by": "", "kind": "note", "text": "", "x": 1}]),
    "sessions": stated(sessions=[None]),
    "layout": stated(layout={"channels": 3}),
    "short layout": stated(layout__units=["s"]),
    "units": stated(layout__units={"position": "__import__('os')"}),
    "calibrations": stated(calibrations={"position": {"calibration": "x"}}),
    "coefficients": stated(calibrations={"position": {"calibration": {"coefficients": "x"}}}),
    "files": stated(files={"samples.parquet": {"sha256": 1, "bytes": -1}}),
    "test": stated(test={"result": [], "passed": "x"}),
    "backend": stated(backend={"kind": {"a": 1}}),
    "source text": stated(procedure__text=5),
    "more of a source": stated(rig__more=5),
    "rig text": stated(rig__text="a: &a [x,x,x]\nb: [*a,*a]"),
    "assumed": stated(assumed={"x": "y"}),
    "truncated table": lambda folder: (folder / "samples.parquet").write_bytes(b"PAR1"),
    "texts for numbers": table("samples.parquet", {"time": ["a"], "record": ["b"], "position": ["c"]}),
    "numbers too large": table(
        "samples.parquet", {"time": [0.0], "record": [0], "position": pa.array([2**64 - 1], pa.uint64())}
    ),
    "no columns": table("records.parquet", {}),
    "lists for records": table("records.parquet", {"record": [[1]], "name": [["x"]]}),
    "no events": table("events.parquet", {"kind": ["command"], "data": ["[[["]}),
    **{f"event data {data}": event(data) for data in ("[[[", "{}", '{"actuator": [], "value": "x"}', "null")},
    "measures of events": event('{"name": 1}', kind="measure"),
    **(
        {
            f"{name} is {what}": make(name)
            for name in ("run.json", "log.jsonl", "samples.parquet", "state.json", "annotations.jsonl")
            for what, make in (("a pipe", pipe),)
        }
        | {
            "samples are endless": linked("samples.parquet", "/dev/zero"),
            "samples are a text": linked("samples.parquet", "/etc/passwd"),
            "log is a text": linked("log.jsonl", "/etc/passwd"),
            "link to itself": linked("run.json", "run.json"),
        }
        if hasattr(os, "mkfifo")
        else {}
    ),
}


@pytest.fixture
def two(make_run: RunMaker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with a run, and one to be forged."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    forged = make_run(records=1, rows=5).with_name(FORGED)
    shutil.copytree(forged.with_name("20261121-093000-stroke"), forged)
    stated(id=FORGED)(forged)
    return forged


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_one_run_hides_no_other_and_every_command_says_what_is_wrong(two: Path, damage: Damage) -> None:
    """Of 329 such commands 42 used to end with a traceback, in lists without any run."""
    good = "20261121-093000-stroke"
    damage(two)
    assert good in [run.id for run in list_runs("runs")]
    assert good in [run.id for run in page_of_runs(Path("runs")).runs]
    catalogue = Catalogue(Site(Project(two.parent.parent, two.parent), Jobs(two.parent.parent)))
    assert good in [run["id"] for run in catalogue.page(PageRequest({}, {}, {}))["runs"]]
    with suppress(RigctlError):
        json.dumps(catalogue.show(PageRequest({"run": FORGED}, {}, {})), default=str)
    for words in (
        ["runs", "list"],
        ["runs", "list", "--json"],
        ["runs", "list", "--where", "id IN (SELECT run FROM channels WHERE high > -1)"],
        ["runs", "show", FORGED],
        ["runs", "show", FORGED, "--json"],
        ["runs", "sql", "SELECT id, started FROM runs"],
        ["runs", "sql", "SELECT count(*), max(position) FROM samples"],
        ["export", FORGED, "-o", "x.csv", "--force"],
        ["export", FORGED, "--to", "junit", "-o", "x.xml", "--force"],
        ["report", FORGED, "-o", "x.html", "--force"],
        ["runs", "verify", FORGED],
    ):
        done = call(*words)
        assert done.exception is None or isinstance(done.exception, RigctlError | SystemExit), words
        assert "\x1b" not in done.output, words
        if words[:2] == ["runs", "list"]:
            assert good in done.output, words


def test_a_changed_file_is_damaged_whatever_format_it_states(two: Path) -> None:
    """An unknown format used to switch the check off."""
    for value in ("2", None, 0, -1, 1, True, 1.5, []):
        unsealed(format=value, operator="Eve")(two)
        assert [run.status for run in list_runs("runs")] == ["finished", "damaged"], value


def test_an_ending_that_somebody_has_to_look_at_is_shown(two: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In red, first in the list and of the run itself."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "400")
    doubt = {"result": "fail", "passed": 1, "missed": 2}
    stated(unconfirmed="heater_1, heater_2", test=doubt)(two)
    listed, shown = (call("runs", *words).output for words in (["list"], ["show", FORGED]))
    assert "OUTPUTS NOT CONFIRMED SAFE" in listed
    assert "\x1b[1;31mfail" in listed
    assert "\x1b[1;31mOUTPUTS NOT CONFIRMED SAFE: heater_1, heater_2 may still be on" in shown
    assert shown.index("NOT CONFIRMED") < shown.index("status")
    (doubtful,) = list_runs("runs", where="unconfirmed IS NOT NULL")
    assert doubtful.unconfirmed == "heater_1, heater_2"
    answer = call("runs", "sql", "SELECT unconfirmed FROM runs WHERE unconfirmed IS NOT NULL")
    assert "heater_1, heater_2" in answer.output
    catalogue = Catalogue(Site(Project(two.parent.parent, two.parent), Jobs(two.parent.parent)))
    assert catalogue.show(PageRequest({"run": FORGED}, {}, {}))["unconfirmed"] == "heater_1, heater_2"
