"""Calls of other procedures and their arguments."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from rigctl.errors import RigctlError
from rigctl.plan import GroupKind, Leaf, Plan, RecordNode, walk
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig
from rigctl.steps.heat import Heat


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(dedent(text), encoding="utf-8", newline="\n")
    return path


def plan_of(path: Path, rig: Rig, **arguments: str | float) -> Plan:
    return expand(load_procedure(path), rig, arguments)


CALLED = """
    procedure: inner
    arguments:
      to: {unit: degC, low: 10 degC, high: 80 degC}
      settle: 5 s
    steps:
      - heat: {to: $to, settle: $settle}
      - record: {name: r}
        do: [wait: 1 s]
    finally: [wait: 2 s]
    """


def test_a_called_procedure_sees_its_arguments_and_defaults(tmp_path: Path, rig: Rig) -> None:
    write(tmp_path, "inner.yaml", CALLED)
    outer = write(tmp_path, "outer.yaml", """
        procedure: outer
        steps:
          - for: {oil: [20 degC, 30 degC]}
            do:
              - call: {procedure: inner.yaml, with: {to: $oil + 1 K}}
        """)  # fmt: skip
    plan = plan_of(outer, rig)
    heats = [n.action for n in walk(plan.root) if isinstance(n, Leaf) and isinstance(n.action, Heat)]
    assert [(heat.to, heat.settle) for heat in heats] == [(pytest.approx(294.15), 5.0), (304.15, 5.0)]
    calls = [n for n in walk(plan.root) if getattr(n, "kind", None) is GroupKind.CALL]
    assert dict(calls[0].bindings) == {"to": "21 degC", "settle": "5 s"}  # type: ignore[union-attr]
    assert calls[0].finally_ is not None  # type: ignore[union-attr]
    records = [n for n in walk(plan.root) if isinstance(n, RecordNode)]
    assert [set(record.sweep) for record in records] == [{"oil"}, {"oil"}]


def test_a_called_procedure_does_not_see_the_variables_of_its_caller(tmp_path: Path, rig: Rig) -> None:
    write(tmp_path, "inner.yaml", "procedure: inner\nsteps: [{wait: $pause}]\n")
    outer = write(tmp_path, "outer.yaml", """
        procedure: outer
        steps:
          - for: {pause: [1 s]}
            do: [{call: inner.yaml}]
        """)  # fmt: skip
    with pytest.raises(RigctlError) as caught:
        plan_of(outer, rig)
    message = str(caught.value)
    assert "inner.yaml:2:16: wait: unknown variable, got 'pause'" in message
    assert "Called from" in message
    assert "outer.yaml:5:10" in message


def test_recursion_is_refused_with_the_chain(tmp_path: Path, rig: Rig) -> None:
    for name, other in (("a", "b"), ("b", "c"), ("c", "a")):
        write(tmp_path, f"{name}.yaml", f"procedure: {name}\nsteps: [{{call: {other}.yaml}}]\n")
    with pytest.raises(RigctlError, match=r"a\.yaml calls b\.yaml calls c\.yaml calls a\.yaml") as caught:
        plan_of(tmp_path / "a.yaml", rig)
    assert str(caught.value).startswith(
        f"{(tmp_path / 'c.yaml').as_posix()}:2:16: call: a procedure calls itself"
    )


def test_a_missing_file_is_reported_with_the_folders_searched(tmp_path: Path, rig: Rig) -> None:
    outer = write(tmp_path, "outer.yaml", "procedure: o\nsteps: [{call: inner.yaml}]\n")
    with pytest.raises(RigctlError, match=r"outer\.yaml:2:16: call: there is no such file") as caught:
        plan_of(outer, rig)
    assert (tmp_path / "inner.yaml").as_posix() in str(caught.value)


@pytest.mark.parametrize(
    ("given", "pieces"),
    [
        ("{}", ["argument to: is missing", "a temperature"]),
        ("{to: 30 bar}", ["argument to: wrong dimension", "'30 bar'"]),
        ("{to: 30}", ["argument to: the unit is missing", "'30'"]),
        ("{to: 85 degC}", ["argument to: too large", "'85 degC'", "at most 80 degC"]),
        ("{to: 30 degC, setle: 3 s}", ["unknown argument of 'inner'", "'setle'", "did you mean 'settle'?"]),
        ("{to: [30 degC, 40 degC]}", ["argument to: is a list", "a single quantity"]),
    ],
)
def test_arguments_of_a_call_are_checked(tmp_path: Path, rig: Rig, given: str, pieces: list[str]) -> None:
    write(tmp_path, "inner.yaml", CALLED)
    outer = write(
        tmp_path,
        "outer.yaml",
        f"procedure: o\nsteps:\n  - call: {{procedure: inner.yaml, with: {given}}}\n",
    )
    with pytest.raises(RigctlError) as caught:
        plan_of(outer, rig)
    assert f"{outer.as_posix()}:3:" in str(caught.value)
    for piece in pieces:
        assert piece in str(caught.value)


LISTED = """
    procedure: listed
    arguments:
      points: {default: [20 degC, 30 degC], low: 10 degC, high: 80 degC}
      times: 2
    steps:
      - for: {oil: $points}
        repeat: $times
        do: [heat: $oil]
    """


def test_arguments_on_the_command_line_may_be_lists(tmp_path: Path, rig: Rig) -> None:
    path = write(tmp_path, "listed.yaml", LISTED)
    plan = plan_of(path, rig, points="40 degC, 50 degC,60 degC", times="1")
    assert [n.label for n in plan.root.children[0].children] == [  # type: ignore[union-attr]
        "oil=40 degC", "oil=50 degC", "oil=60 degC"
    ]  # fmt: skip
    assert dict(plan.arguments) == {"points": "40 degC, 50 degC, 60 degC", "times": "1"}
    assert len(plan_of(path, rig, points="[40 degC]").root.children[0].children) == 2  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("given", "piece"),
    [
        ({"points": "90 degC"}, "argument points: too large, got '90 degC'; expected at most 80 degC"),
        ({"points": ""}, "argument points: is an empty list"),
        ({"points": "warm"}, "argument points: not a quantity"),
        ({"times": "2 bar"}, "argument times: wrong dimension"),
        ({"times": "1.5"}, "repeat: not a whole number, got '$times = 1.5'"),
        ({"tims": "1"}, "unknown argument of 'listed', got 'tims'; did you mean 'times'?"),
    ],
)
def test_arguments_on_the_command_line_are_checked(
    tmp_path: Path, rig: Rig, given: dict[str, str], piece: str
) -> None:
    path = write(tmp_path, "listed.yaml", LISTED)
    with pytest.raises(RigctlError) as caught:
        plan_of(path, rig, **given)
    assert piece in str(caught.value)


def test_a_list_can_be_passed_to_a_called_procedure(tmp_path: Path, rig: Rig) -> None:
    write(tmp_path, "listed.yaml", LISTED)
    outer = write(tmp_path, "outer.yaml", """
        procedure: outer
        arguments:
          temperatures: [25 degC, 35 degC, 45 degC]
        steps:
          - call: {procedure: listed.yaml, with: {points: $temperatures, times: 1}}
          - call: {procedure: listed.yaml, with: {points: [22 degC], times: 1}}
        """)  # fmt: skip
    plan = plan_of(outer, rig)
    heats = [n.action.to for n in walk(plan.root) if isinstance(n, Leaf) and isinstance(n.action, Heat)]
    assert heats == pytest.approx([298.15, 308.15, 318.15, 295.15])


@pytest.mark.parametrize(
    ("declared", "piece"),
    [
        ("{}", "an argument needs a unit or a default"),
        ("{default: $x}", "an argument's bounds and default have no variables"),
        ("[]", "an empty list"),
        ("{unit: sek}", "unknown unit"),
    ],
)
def test_declarations_of_arguments_are_checked(tmp_path: Path, declared: str, piece: str) -> None:
    path = write(tmp_path, "p.yaml", f"procedure: p\narguments: {{a: {declared}}}\nsteps: [wait: 1 s]\n")
    with pytest.raises(RigctlError) as caught:
        load_procedure(path)
    assert f"{path.as_posix()}:2:" in str(caught.value)
    assert piece in str(caught.value)


def test_a_procedure_without_a_rig_is_reported(tmp_path: Path) -> None:
    path = write(tmp_path, "p.yaml", "procedure: p\nsteps: [wait: 1 s]\n")
    with pytest.raises(RigctlError, match="names no rig"):
        _ = load_procedure(path).rig_path
    path = write(tmp_path, "q.yaml", "procedure: q\nrig: nowhere.yaml\nsteps: [wait: 1 s]\n")
    with pytest.raises(RigctlError, match=r"q\.yaml:2:6: rig: there is no such file"):
        _ = load_procedure(path).rig_path
