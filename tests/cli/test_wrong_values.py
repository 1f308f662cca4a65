"""Every option and argument of every command, given what it cannot take: one message in one style.

The commands are read from the program itself, so that a new option is tried, or has to be described here.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from rigctl.cli.catalogue import ENTRIES
from rigctl.cli.commands.init import create_project
from rigctl.cli.main import _carry_out, load_command
from rigctl.dataset.importing import import_file
from rigctl.rig import load_rig
from systems import needs_simavr

BENCH = "rigs/hl32-bench.yaml"
MODEL = "models/hl32-textbook.yaml"
PROCEDURE = "procedures/quick-check.yaml"
RIG, WITH_MODEL = ("--rig", BENCH), ("--model", MODEL)

#: a call of each command that would be carried out, positional arguments first
CALLS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "demo": ((), ()),
    "init": ((), ()),
    "check": ((PROCEDURE,), ()),
    "simulate": ((PROCEDURE,), ()),
    "run": ((PROCEDURE,), ()),
    "resume": (("latest",), ()),
    "pause": ((), ()),
    "continue": ((), ()),
    "abort": ((), ()),
    "off": ((), RIG),
    "jog": (("valve", "extend"), RIG),
    "monitor": ((), RIG),
    "calibrate": (("supply_pressure",), RIG),
    "runs list": ((), ()),
    "runs show": (("latest",), ()),
    "runs verify": (("latest",), ()),
    "runs upload": (("latest",), ("--to", "storage")),
    "runs annotate": (("latest", "a note"), ()),
    "runs exclude": (("latest", "0"), ("--reason", "a spike")),
    "runs sql": (("SELECT 1",), ()),
    "import": (("two.csv",), RIG),
    "export": (("latest",), ()),
    "report": (("latest",), WITH_MODEL),
    "serve": ((), ("--no-browser",)),
    "oil": (("HL32",), ()),
    "compare": (("latest",), WITH_MODEL),
    "frequency": (("latest",), WITH_MODEL),
    "diagnose": (("latest",), WITH_MODEL),
    "discover": (("latest",), WITH_MODEL),
    "design": (("latest",), WITH_MODEL),
    "learn": ((PROCEDURE,), (*WITH_MODEL, "--budget", "10 min")),
    "compensate": (
        ("latest",),
        (*WITH_MODEL, "--keep", "stroke = 110 mm", "--vary", "pressure", "--over", "oil_temperature"),
    ),
    "survey": (("latest",), WITH_MODEL),
    "model show": ((MODEL,), ()),
    "model diff": ((MODEL, MODEL), ()),
    "model history": ((MODEL,), ()),
    "model fit": ((MODEL, "latest"), ()),
    "model add": ((MODEL, "piston_leakage", "latest"), ()),
    "model remove": ((MODEL, "piston_leakage", "latest"), ()),
    "model set": ((MODEL, "moving_mass=3 kg"), ()),
    "model export": ((MODEL,), ()),
    "family new": (("mine",), ("--csv", "two.csv")),
    "effects list": ((), ()),
    "effects show": (("piston_leakage",), ()),
    "effects check": (("piston_leakage",), ()),
    "emulate": ((), ()),
    "validate": ((), ()),
    "schema": (("rig",), ()),
    "doctor": ((), ()),
}

OURS = ("nothing.yaml", "picture.png", "folder")
RUN = ("latst", "nothing", "picture.png")
NUMBER = ("seven", "12 foo")
TIME = ("seven", "12", "12 foo", "5 km/h")
NAME = ("nothing_like_it", "\x1b[31mä")
PAIR = ("oil", "=60")
EXPRESSION = ("oil = 60", "picture.png")
#: what cannot be wrong before it is used: free text, a name to be made, an address that is tried
ANY: tuple[str, ...] = ()

#: wrong values of each parameter, by its name; where a command has its own, by both
WRONG: dict[str, tuple[str, ...]] = {
    "allow_driver": ("no-name", "no_such_package", "os"),
    "file": OURS,
    "rig": OURS,
    "model": OURS,
    "first": OURS,
    "second": OURS,
    "procedure": OURS,
    "plant": OURS,
    "mapping": OURS,
    "family": ("hydraulic_cylindre", "nothing.yaml"),
    "files": ("nothing.csv", "picture.png", "folder"),
    "csv": ("nothing.csv", "picture.png", "folder"),
    "points": ("nothing.csv", "folder"),
    "oil points": NUMBER,
    "run": RUN,
    "runs": RUN,
    "recording": ("latst",),
    "from_runs": RUN,
    "arg": PAIR,
    "answer": PAIR,
    "assume": PAIR,
    "values": PAIR,
    "columns": PAIR,
    "unit": PAIR,
    "standing": PAIR,
    "hold_out": EXPRESSION,
    "only": EXPRESSION,
    "where": ("oil = 60", "12"),
    "backend": NAME,
    "speed": ("seven", "5 km/h"),
    "duration": TIME,
    "budget": TIME,
    "valid_for": TIME,
    "rival_timeout": TIME,
    "rival": ("nothing.fmu", "picture.png"),
    "fmu": ("nothing.fmu", "picture.png", "folder"),
    "variable": PAIR,
    "effect": NAME,
    "add_effect": NAME,
    "remove_effect": NAME,
    "alongside": NAME,
    "actuator": ("vlave",),
    "channel": ("suply_pressure",),
    "input_name": ("vlave",),
    "output_name": ("suply_pressure",),
    "resolution": ("seven", "12 foo", "0 Hz", "5 km/h"),
    "jog value": ("extnd", "5 km/h"),
    "fault": NAME,
    "dates": NAME,
    "zone": ("Europe/Berlim",),
    "times": NAME,
    "split": NAME,
    "encoding": NAME,
    "decimal": NAME,
    "delimiter": ("::",),
    "resample": ("5 km/h",),
    "table": NAME,
    "to": NAME,
    "form": NAME,
    "page": ("folder",),
    "serve page": NAME,
    "kind": NAME,
    "tier": NAME,
    "name": ANY,
    "oil name": ("HL23",),
    "temperature": ("12", "5 km/h", "warm"),
    "pressure": ("12", "5 km/h", "high"),
    "slot": NAME,
    "separate": NAME,
    "keep": NAME,
    "vary": ANY,  # the measures of the runs come first: tests/compensation has a run with some
    "compensate over": ANY,
    "over": NAME,
    "by": NAME,
    "share": NAME,
    "effects": NAME,
    "template": NAME,
    "cluster": ("nowhere",),
    "output": ("folder",),
    "discover output": ("picture.png",),
    "date": ("2026-13-45",),
    "day": ("2026-13-45",),
    "reference_uncertainty": ("5 km/h", "seven"),
    "query": ("SELEKT 1",),
    "reuse": ("nothing.jsonl", "folder"),
    "against": NAME,
    "commanded": NAME,
    "measured": NAME,
    "inputs": NAME,
    "outputs": NAME,
    "leave": NAME,
    "condition": NAME,
    "certificate": ("nothing.pem",),
    "key": ("nothing.pem",),
    "directory": ("picture.png",),
    "project": ("nothing",),
    "figure": ("folder",),
    "figures": ("picture.png",),
    "junit": ("folder",),
    "laws": ("picture.png",),
    "out": ("picture.png",),
    "save_mapping": ("folder",),
    "sheet": ("folder",),
    "precision": NUMBER,
    **dict.fromkeys(
        ("host", "licence", "link", "missing", "notes", "operator", "part", "port", "reason"), ANY
    ),
    **dict.fromkeys(("reference", "serial_number", "text", "title", "runs upload to"), ANY),
}
#: options that only make sense with another one
WITH: dict[str, tuple[str, ...]] = {
    "run recording": ("--backend", "replay"),
    "serve certificate": ("--key", "two.csv"),
    "serve key": ("--certificate", "two.csv"),
    "calibrate run": ("--against", "reference"),
    "calibrate against": ("--run", "latest"),
    "import output": ("--dry-run",),
}


class Case(NamedTuple):
    """A parameter of a command, and a value that it cannot take."""

    path: str
    param: Any
    value: str

    def words(self) -> list[str]:
        """The command line."""
        positional, options = CALLS[self.path]
        more = WITH.get(f"{self.path} {self.param.name}", ())
        if self.param.param_type_name == "option":
            name = max(self.param.opts, key=len)
            kept = [pair for pair in _pairs(options) if pair[0] != name]
            given = [f"{name}={self.value}", *(word for pair in kept for word in pair), *more]
            return [*self.path.split(), *positional, *given]
        arguments = [one.name for one in _params(self.path) if one.param_type_name == "argument"]
        place = arguments.index(self.param.name)
        words = [*positional[:place], self.value, *positional[place + 1 :]]
        return [*self.path.split(), *words, *options, *more]


def _pairs(options: tuple[str, ...]) -> list[tuple[str, ...]]:
    starts = [k for k, word in enumerate(options) if word.startswith("--")]
    return [options[a:b] for a, b in zip(starts, [*starts, len(options)][1:], strict=True)]


def _paths(name: str) -> list[str]:
    nested = getattr(load_command(name), "commands", {})
    return [f"{name} {one}" for one in nested] or [name]


def _params(path: str) -> list[Any]:
    name, _, nested = path.partition(" ")
    command = load_command(name)
    return list((command.commands[nested] if nested else command).params)


def _cases(path: str) -> Iterator[Case]:
    for param in _params(path):
        if getattr(param, "is_flag", False):
            continue
        number = re.search(r"\b(int|float)\b", str(param.type_descriptor.annotation))
        known = WRONG.get(f"{path} {param.name}", WRONG.get(param.name))
        assert known is not None or number, f"{path}: say what {param.name} cannot be"
        for value in ("", *(NUMBER if number else known or ())):
            yield Case(path, param, value)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a run of two short records, and files that are none of rigctl's."""
    folder = tmp_path_factory.mktemp("wrong")
    create_project(folder)
    heading, *rows = (folder / "data" / "unknown-bench.csv").read_text("utf-8").splitlines()
    few = [row for row in rows if row.split(",")[1] in ("001", "002")]
    (folder / "two.csv").write_text("\n".join([heading, *few]), "utf-8")
    with chdir(folder):
        import_file(Path("two.csv"), load_rig(Path(BENCH)), Path("runs"))
    (folder / "folder").mkdir()
    (folder / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(256)))
    return folder


def _tried(words: list[str], patch: pytest.MonkeyPatch) -> tuple[object, str, str]:
    """The exit code of a call, and what it prints on stdout and stderr."""
    patch.setattr(sys, "argv", ["rigctl", *words])
    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            _carry_out()
        except SystemExit as end:
            code = end.code
    return code, out.getvalue(), err.getvalue()


def _faults(case: Case, code: object, out: str, err: str) -> list[str]:
    """What is wrong with the answer to a wrong value."""
    told = [line for line in err.splitlines() if line.startswith("rigctl: ")]
    message = told[0] if told else ""
    names = [name for name in case.param.opts if name.startswith("--")] or [
        str(case.param.metavar or case.param.name.upper()).strip("[].")
    ]
    suggested = re.search(r"did you mean '(.*?)'", message)
    found = {
        f"exit code {code}": code != 2,
        f"{len(told)} messages": len(told) != 1 or err.splitlines()[-1] != message,
        "the name is missing": not any(name in message for name in names)
        and not (case.param.param_type_name == "argument" and message.startswith(f"rigctl: {case.value}: ")),
        "it suggests what was typed": suggested is not None and suggested.group(1) == case.value,
        "characters of no text": re.search(r"[^\x20-\x7e]", message.replace("ä", "").replace("…", ""))
        is not None,
        "a box": "╭" in err + out,
        "something on stdout": bool(out),
    }
    return [text for text, wrong in found.items() if wrong]


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=needs_simavr if path == "emulate" else ())
        for entry in ENTRIES
        for path in _paths(entry.name)
    ],
)
def test_a_wrong_value_is_refused_with_one_message_that_names_its_option(
    path: str, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project)
    before = _files(project)
    wrong = []
    for case in _cases(path):
        code, out, err = _tried(case.words(), monkeypatch)
        wrong += [
            f"{case.param.name}={case.value!r}: {text}: {err!r}" for text in _faults(case, code, out, err)
        ]
    assert not wrong, "\n".join(wrong)
    assert _files(project) == before, "a refused call has left something behind"


def _files(project: Path) -> list[Path]:
    """Everything in the project but what `learn` keeps for each call, also where it then refuses the call."""
    return sorted(one for one in project.rglob("*") if "learning" not in one.relative_to(project).parts)
