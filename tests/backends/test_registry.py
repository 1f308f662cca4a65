"""Backends by name."""

from __future__ import annotations

import subprocess
import sys

import pytest

from rigctl.backends.registry import backend_names, create_backend
from rigctl.clock import VirtualClock
from rigctl.errors import RigctlError
from rigctl.rig import Rig


def test_the_rig_file_names_the_default_backend(rig: Rig) -> None:
    assert create_backend(rig, None, VirtualClock()).identity["kind"] == "simulated"
    assert "simulated" in backend_names()


@pytest.mark.parametrize(
    ("choice", "options", "message"),
    [
        ("simulatd", {}, "unknown backend, got 'simulatd'; did you mean 'simulated'?"),
        ("simulated", {"nois": "off"}, "did you mean 'noise'?"),
        ("simulated", {"noise": "loud"}, "noise is switched on or off, got 'loud'"),
        ("simulated", {"seed": -1}, "not a seed, got '-1'"),
        ("simulated", {"seed": "seven"}, "not a seed, got 'seven'"),
        ("simulated", {"faults": 3}, "faults is a text or a list of texts"),
        ("simulated", {"faults": ["valve_stuk@1 s"]}, "did you mean 'valve_stuck'?"),
    ],
)
def test_an_invalid_choice_of_backend_is_refused(
    rig: Rig, choice: str, options: dict[str, object], message: str
) -> None:
    with pytest.raises(RigctlError) as problem:
        create_backend(rig, choice, VirtualClock(), options)
    assert message in str(problem.value)


def test_command_line_options_override_those_of_the_rig_file(rig: Rig) -> None:
    described = rig.model_copy(
        update={"backend": rig.backend.model_copy(update={"options": {"seed": 5, "noise": "off"}})}
    )
    identity = create_backend(described, None, VirtualClock(), {"seed": 6}).identity
    assert (identity["seed"], identity["noise"]) == ("6", "off")


def test_choosing_a_backend_imports_no_heavy_library() -> None:
    code = (
        "import sys, rigctl.backends.registry as r; r.backend_names();"
        "print([m for m in ('numpy', 'pandas', 'pyarrow', 'numba', 'serial', 'pint') if m in sys.modules])"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
