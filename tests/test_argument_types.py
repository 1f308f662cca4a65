"""Public functions refuse arguments of a wrong type in one sentence."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import rigctl
from rigctl.argument_types import _types, checks_argument_types
from rigctl.runner.operators.operator import Operator

ROOT = Path(__file__).parents[1]


class Odd:
    """An object that no function takes."""


def parameters() -> list[tuple[str, Callable[..., Any], str]]:
    """Every argument of the public functions, and of the methods of a run and of a model."""
    functions = {name: getattr(rigctl, name) for name in rigctl.__all__}
    for kind in (rigctl.Run, rigctl.Model):
        functions |= {
            f"{kind.__name__}.{name}": member
            for name, member in vars(kind).items()
            if inspect.isfunction(member) and not name.startswith("_") and len(takes(member)) > 1
        }
    return [
        (name, function, argument)
        for name, function in functions.items()
        if inspect.isfunction(function)
        for argument in takes(function)
        if argument != "self"
    ]


def takes(function: Callable[..., Any]) -> list[str]:
    return list(inspect.signature(function).parameters)


#: arguments that are for other parts of rigctl and not for users
INSIDE = {"Model.system", "Model.same_bench"}


@pytest.mark.parametrize(
    ("name", "function", "argument"),
    [one for one in parameters() if one[0] not in INSIDE],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_every_argument_of_a_public_function_is_checked(
    name: str, function: Callable[..., Any], argument: str
) -> None:
    """`compare("latest", model)` ended in an AttributeError of some inner function."""
    named = {one: Odd() for one in takes(function) if one == argument or one in required(function) - {"self"}}
    for other in named.keys() - {argument}:
        named[other] = acceptable(name, other)
    first = [None] if "self" in takes(function) else []
    with pytest.raises(rigctl.RigctlError) as caught:
        function(*first, **named)
    assert caught.value.what == f"{name}: wrong kind of value for {argument}"
    assert caught.value.expected
    assert "Odd" in str(caught.value)
    assert "\n" not in str(caught.value)


def required(function: Callable[..., Any]) -> set[str]:
    known = inspect.signature(function).parameters.values()
    return {one.name for one in known if one.default is one.empty}


def acceptable(name: str, argument: str) -> Any:
    """A value of the right type for another argument that is needed."""
    model = rigctl.load_model(ROOT / "models" / "hl32-textbook.yaml")
    procedure = rigctl.load_procedure(ROOT / "procedures" / "quick-check.yaml")
    values = {
        "model": model,
        "models": [model],
        "procedure": procedure,
        "rig": model.rig,
        "values": {},
        "run": rigctl.Run(Path("none"), {}),
        "compared": rigctl.Comparison((), (), (), ()),
        "family": "hydraulic_cylinder",
    }
    if name in ("simulate", "run"):
        return "none"
    values["runs"] = "none" if name == "import_file" else [values["run"]]
    return values.get(argument, "none")


def test_a_wrong_type_is_answered_with_the_function_that_makes_the_right_one() -> None:
    with pytest.raises(rigctl.RigctlError) as caught:
        rigctl.compare("latest", [])  # type: ignore[arg-type]
    assert str(caught.value) == (
        "compare: wrong kind of value for runs, got 'latest'; expected a list, each element a Run. "
        "rigctl.open_run returns one"
    )


def test_one_object_instead_of_a_list_is_answered_with_the_list() -> None:
    model = rigctl.load_model(ROOT / "models" / "hl32-textbook.yaml")
    with pytest.raises(rigctl.RigctlError, match=r"expected a list.*Put it into a list"):
        rigctl.compare([], model)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "good", "bad", "called"),
    [
        (int, [3, np.int64(3)], [3.0, "3", None], "a whole number"),
        (float, [3, 3.5, np.float32(1)], ["3", None], "a number"),
        (bool, [True, np.True_], [1, "yes", None], "True or False"),
        (str | Path, ["a", Path("a")], [b"a", 3, None], "a path"),
        (str | None, ["a", None], [3, []], "text or None"),
        (
            Sequence[str],
            [["a"], ("a",), [], np.array(["a"])],
            ["a", [1], {"a": 1}, iter("a")],
            "a list, each",
        ),
        (Mapping[str, str], [{}, {"a": "b"}], [[], {"a": 1}, {1: "a"}], "a mapping of text to text"),
        (Literal["a", "b"], ["a"], ["c", 1], "'a' or 'b'"),
        (Callable[[str], None], [print], ["print", None], "a function"),
    ],
)
def test_types_are_taken_and_refused(kind: Any, good: list[Any], bad: list[Any], called: str) -> None:
    def function(value: object) -> object:
        return value

    function.__annotations__["value"] = kind
    checked = checks_argument_types(function)
    for value in good:
        assert checked(value) is value
    for value in bad:
        with pytest.raises(rigctl.RigctlError, match="function: wrong kind of value for value") as caught:
            checked(value)
        assert called in str(caught.value.expected)


def test_an_object_stands_for_a_protocol_by_its_methods() -> None:
    @checks_argument_types
    def function(operator: Operator | None = None) -> None:
        pass

    class Own:
        def __getattr__(self, name: str) -> Callable[[], None]:
            return lambda: None

    function()
    function(Own())
    with pytest.raises(rigctl.RigctlError, match="expected an Operator or None"):
        function(Odd())  # type: ignore[arg-type]


def test_a_missing_argument_is_the_type_error_of_python() -> None:
    with pytest.raises(TypeError, match=r"compare\(\) missing 1 required positional argument: 'models'"):
        rigctl.compare([])  # type: ignore[call-arg]


def test_the_signature_and_the_text_of_a_checked_function_stay() -> None:
    assert list(inspect.signature(rigctl.compare).parameters)[:2] == ["runs", "models"]
    assert rigctl.compare.__name__ == "compare"
    assert (rigctl.compare.__doc__ or "").startswith("Compare each model")
    inner = inspect.unwrap(rigctl.load_model)
    assert set(_types(inner)) == {"path"}
