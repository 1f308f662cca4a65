"""Write a model as an FMU: description, C sources, and the library compiled from them on this computer.

In: a `Model`. Out: an archive whose equations are the straight-line code that the engine compiles, as C
(`equations`), with FMI's functions and an integration method in ``slave.c``: it runs where rigctl is not
installed. Equal models give equal files.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from rigctl.engine.source import source_of
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.write import replace_file, write_error
from rigctl.model.fmu.description import model_description
from rigctl.model.fmu.equations import equations_header
from rigctl.model.inputs import input_values
from rigctl.model.model import Model
from rigctl.model.plant import initial_state, plant_inputs

#: the folder of a library, its ending, and how it is made, by ``sys.platform``
_PLATFORMS: Final = {
    "linux": ("linux64", ".so"),
    "darwin": ("darwin64", ".dylib"),
    "win32": ("win64", ".dll"),
}
#: time-out for a compiler, s
_PATIENCE: Final = 120.0
#: every file of an archive has this date, so that equal models give equal files
_DATE: Final = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Exported:
    """The result: sizes, and the platform of the compiled library; None for sources alone."""

    path: Path
    states: int
    inputs: int
    parameters: int
    outputs: int
    platform: str | None


def export_fmu(model: Model, path: Path, *, sources_only: bool = False) -> Exported:
    """Write a model as a slave for co-simulation of FMI 2.0.

    Its inputs are those of the family, its parameters those that a fit can change, each with the model's
    value, its outputs the channels of the rig. All values are SI. An FMU holds its inputs between two
    communication points, and integrates with its own method to a relative tolerance of 1e-8, or the one
    requested by the simulator.

    Parameters
    ----------
    path: ends in ``.fmu``; an existing file is replaced.
    sources_only: for a simulator that compiles them itself.

    Raises
    ------
    RigctlError
        there is no compiler or it fails, the file cannot be written, or the model consists of an FMU.
    """
    if path.suffix.lower() != ".fmu":
        raise RigctlError("unknown kind of file", value=path.name, expected="a name that ends in .fmu")
    program = model.family.program
    if program is not None:
        raise RigctlError(
            f"a model that {program.noun} computes already has no equations to export", value=program.name
        )
    # the GUID is a hash of all that the library computes from, so that a simulator refuses a description with
    # another library; equal models have equal ones
    system = model.system()
    states, inputs = _start(model)
    ordered = [states[name] for name in system.state_names]
    about = f"{source_of(system).digest} {ordered!r} {inputs!r} {system.nominal!r}"
    digest = hashlib.sha256(about.encode()).hexdigest()
    guid = "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"
    # a C identifier, by the standard also the name of the library
    identifier = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    identifier = identifier if not identifier[:1].isdigit() else f"m_{identifier}"
    description = model_description(
        system,
        name=model.name,
        identifier=identifier,
        guid=guid,
        version=version("rigctl"),
        about=model.summary(),
        states=ordered,
        inputs=inputs,
        meanings=_meanings(model),
    )
    folder = Path(__file__).parent
    files = {
        "modelDescription.xml": description,
        "sources/slave.c": (folder / "slave.c").read_bytes(),
        "sources/equations.h": equations_header(system, guid, ordered, inputs).encode(),
    }
    platform = None
    if not sources_only:
        platform, ending = _platform()
        files[f"binaries/{platform}/{identifier}{ending}"] = _compiled(files, identifier + ending)
    with write_error(path):
        _write(path, files)
    counts = (len(system.states), len(system.inputs), len(system.parameters), len(system.outputs))
    return Exported(path, *counts, platform)


def _start(model: Model) -> tuple[dict[str, float], list[float]]:
    """Initial states by name and inputs in order: from the rig's simulation section, nothing commanded."""
    effects = [model.effect(name) for name in sorted(model.effects)]
    if model.rig is None:
        return initial_state(model.family, effects), [item.value for item in model.family.inputs]
    known = {state.name for state in model.family.states}
    read = {name: float(value) for name, value in model.rig.simulation.initial.items() if name in known}
    states = initial_state(model.family, effects, read)
    commands = dict.fromkeys(model.rig.actuators, 0.0)
    role = model.rig.roles.set_pressure
    if role is not None and role.channel in states:
        commands[role.actuator] = states[role.channel]
    return states, input_values(plant_inputs(model.rig, model.family).sources, commands)


def _meanings(model: Model) -> Mapping[str, str]:
    """The family's descriptions of its variables."""
    family = model.family
    meanings = {item.name: item.meaning for item in family.inputs}
    return meanings | {item.name: item.meaning for item in family.parameters}


def _platform() -> tuple[str, str]:
    if sys.platform not in _PLATFORMS or sys.maxsize < 2**32:
        raise RigctlError(
            "FMI 2.0 has no name for this platform", value=sys.platform, hint="Write '--sources-only'"
        )
    return _PLATFORMS[sys.platform]


def _compiled(files: Mapping[str, bytes], library: str) -> bytes:
    """The shared library made from the sources by this computer's C compiler.

    Raises
    ------
    RigctlError
        there is none, or it fails.
    """
    with TemporaryDirectory(prefix="rigctl-fmu-") as folder:
        for name in ("slave.c", "equations.h"):
            (Path(folder) / name).write_bytes(files[f"sources/{name}"])
        # in an empty folder, with two files whose names are fixed: no word of a model can become an option
        command = _compiler(library)
        try:
            completed = subprocess.run(  # noqa: S603 - the user's own compiler; no word of the model is in it
                command, cwd=folder, capture_output=True, text=True, timeout=_PATIENCE, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as problem:
            raise RigctlError(f"the C compiler failed: {problem}", exit_code=ExitCode.FAILED) from problem
        output = Path(folder) / library
        if completed.returncode != 0 or not output.exists():
            messages = (completed.stderr or completed.stdout).strip().splitlines()
            raise RigctlError(
                "the C compiler failed",
                value=messages[0] if messages else command[0],
                exit_code=ExitCode.FAILED,
            )
        return output.read_bytes()


def _compiler(library: str) -> list[str]:
    """The command that makes a shared library of ``slave.c``.

    Raises
    ------
    RigctlError
        no compiler is found.
    """
    wished = os.environ.get("CC")
    for name in filter(None, (wished, "cc", "gcc", "clang")):
        compiler = _found(name)
        if compiler is not None:
            shared = ["-dynamiclib"] if sys.platform == "darwin" else ["-shared"]
            # no fused multiply-add, whose rounding depends on the processor
            plain = ["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden"]
            position = [] if sys.platform == "win32" else ["-fPIC"]
            return [compiler, *shared, *position, *plain, "slave.c", "-o", library, "-lm"]
    microsoft = _found("cl") if sys.platform == "win32" else None
    if microsoft is not None:
        return [microsoft, "/nologo", "/LD", "/O2", "slave.c", f"/Fe:{library}"]
    raise RigctlError(
        "there is no C compiler",
        expected="cc, gcc or clang, or cl on Windows",
        hint="Install one, name it in CC, or write '--sources-only'",
    )


def _found(name: str) -> str | None:
    """The path of a program, but not of one in the working folder, where Windows looks first."""
    program = shutil.which(name)
    return program if program is None or Path(name).name != name or Path(program).is_absolute() else None


def _write(path: Path, files: Mapping[str, bytes]) -> None:
    """Write the archive atomically."""
    draft = path.with_name(f".{path.name}.tmp")
    try:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in files.items():
                entry = zipfile.ZipInfo(name, _DATE)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, content)
        replace_file(draft, path)
    finally:
        draft.unlink(missing_ok=True)
