"""Any file gives a plan or one clear error."""

from __future__ import annotations

import random
from pathlib import Path

from hypothesis import example, given, settings
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.plan import Plan
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import load_rig

ROOT = Path(__file__).parents[2]
TEXTS = [
    path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "procedures").glob("*.yaml"))
    # the whole of a file that heats for an hour is not worth a thousand expansions
    if path.name in ("quick-check.yaml", "viscometer.yaml", "calibrate-pressure.yaml", "stroke.yaml")
]
RIG = load_rig(ROOT / "rigs" / "hl32-bench.yaml")

#: fragments that people and programs leave in a file by accident
SPLINTERS = [
    "", " ", ":", "- ", "{", "}", "[", "]", "$", "$supply", "0", "-1", "1e999", "nan", ".inf", "true", "null",
    "~", "*a", "&a ", "!!python/object:os.system ", "\t", "'", '"', "%", "°C", "30 bar", "1 s", "position",
    "for: ", "do: ", "wait: ", "heat: ", "record: ", "finally: ", "((((", "^^", "and", "not ", "\u0000", "\n",
    "😀", "x" * 300, "9" * 400, "- - - -", "? ", "<<: ", "|", ">",
]  # fmt: skip


def outcome(text: str) -> Plan | RigctlError:
    try:
        return expand(parse_procedure(text, ROOT / "procedures" / "broken.yaml"), RIG)
    except RigctlError as error:
        return error


def check(text: str) -> None:
    found = outcome(text)
    if isinstance(found, RigctlError):
        assert str(found)
        assert "Traceback" not in str(found)
        assert "pydantic" not in str(found).casefold()


@settings(max_examples=150)
@given(st.sampled_from(TEXTS), st.integers(0, 2**32), st.integers(1, 4))
def test_fragments_inserted_anywhere_give_a_plan_or_one_error(text: str, seed: int, count: int) -> None:
    chance = random.Random(seed)
    for _ in range(count):
        start = chance.randrange(len(text) + 1)
        end = start + chance.choice((0, 0, 1, 5, 40))
        text = text[:start] + chance.choice(SPLINTERS) + text[end:]
    check(text)


@settings(max_examples=60)
@given(st.sampled_from(TEXTS), st.integers(0, 2**32))
def test_lost_duplicated_or_moved_lines_give_a_plan_or_one_error(text: str, seed: int) -> None:
    chance = random.Random(seed)
    lines = text.splitlines(keepends=True)
    for _ in range(chance.randrange(1, 4)):
        index = chance.randrange(len(lines))
        match chance.randrange(4):
            case 0:
                del lines[index]
            case 1:
                lines.insert(chance.randrange(len(lines)), lines[index])
            case 2:
                lines[index] = "  " + lines[index]
            case _:
                lines[index] = lines[index].lstrip()
    check("".join(lines))


@settings(max_examples=60)
@given(st.text(max_size=300))
@example("procedure: x\nsteps: &a\n  - do: *a\n")
@example("procedure: x\nsteps: [" + "{do: [" * 200)
@example("procedure: [x]\nsteps: {a: b}\n")
def test_any_text_gives_a_plan_or_one_error(text: str) -> None:
    check(text)


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(SPLINTERS),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
VERBS = st.sampled_from(
    ["heat", "set_pressure", "extend", "retract", "wait", "hold", "set", "record", "measure", "prompt", "for",
     "repeat", "while", "if", "call", "do"]
)  # fmt: skip


@settings(max_examples=150)
@given(VERBS, VALUES, VALUES)
def test_any_value_in_any_step_gives_a_plan_or_one_error(verb: str, value: object, inside: object) -> None:
    import json

    step = {verb: value, **({"do": inside} if verb != "do" else {})}
    check(json.dumps({"procedure": "x", "steps": [step]}))


def test_a_missing_field_is_reported_with_an_example_of_its_step() -> None:
    head = "procedure: p\nrig: rigs/hl32-bench.yaml\nsteps:\n"
    error = outcome(f"{head}  - measure: {{name: top, value: last(position)}}\n")
    assert isinstance(error, RigctlError)
    assert (
        "the field 'unit' is missing; expected e.g. measure: {name: zero, value: mean(position), unit: mm"
        in (str(error))
    )
