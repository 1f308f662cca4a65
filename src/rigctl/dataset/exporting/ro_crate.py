"""Runs as a Research Object Crate: their files unchanged, and the metadata needed to use them.

RO-Crate 1.2 (https://w3id.org/ro/crate/1.2): a folder, or a ZIP file, with ``ro-crate-metadata.json`` beside
the data. Each run is a dataset created by one action: by a person, with a bench and a version of rigctl, from
a procedure and a rig file, on a device under test.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset import run_json
from rigctl.dataset.outputs import require_output
from rigctl.dataset.run_id import slug
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import regular
from rigctl.files.write import move_folder, write_error
from rigctl.printable import shown_path
from rigctl.wording import number_of

if TYPE_CHECKING:
    from rigctl.dataset.run import Run

Entity = dict[str, Any]

METADATA: Final = "ro-crate-metadata.json"
_PROFILE: Final = "https://w3id.org/ro/crate/1.2"
_RIGCTL: Final = "#rigctl"
_NO_LICENCE: Final = "#no-licence"
#: media type by file extension
_FORMATS: Final = {
    ".json": "application/json",
    ".jsonl": "application/jsonl",
    ".parquet": "application/vnd.apache.parquet",
    ".yaml": "application/yaml",
}
#: content of each file of a run
_FILES: Final = {
    "run.json": "Everything about the run but its numbers, with the checksums of the other files",
    "samples.parquet": "One row for each sample: time, record, channels and commands",
    "records.parquet": "One row for each record: its sweep values, measures and outcome",
    "events.parquet": "What happened, with exact times of commands",
    "log.jsonl": "The run's log as it was written",
    "annotations.jsonl": "What people said of the run afterwards",
}
#: UN/CEFACT common codes of units (Recommendation 20), the unitCode of schema.org
_UNIT_CODES: Final = {
    "s": "SEC",
    "ms": "C26",
    "min": "MIN",
    "h": "HUR",
    "Hz": "HTZ",
    "1": "C62",
    "%": "P1",
    "m": "MTR",
    "cm": "CMT",
    "mm": "MMT",
    "um": "4H",
    "m/s": "MTS",
    "mm/s": "C16",
    "rpm": "RPM",
    "Pa": "PAL",
    "kPa": "KPA",
    "MPa": "MPA",
    "bar": "BAR",
    "mbar": "MBR",
    "N": "NEW",
    "kN": "B47",
    "degC": "CEL",
    "K": "KEL",
    "W": "WTT",
    "kW": "KWT",
    "V": "VLT",
    "mV": "2Z",
    "A": "AMP",
    "mA": "4K",
    "kg": "KGM",
    "g": "GRM",
    "l": "LTR",
    "l/min": "L2",
    "m^3": "MTQ",
    "N*m": "NU",
    "J": "JOU",
    "rad": "C81",
}


def export_ro_crate(
    runs: Sequence[Run], path: Path, *, licence: str | None = None, title: str | None = None
) -> int:
    """Write runs with all their files as one crate, and return its number of files.

    Parameters
    ----------
    path: a new folder, or a ``.zip`` file.
    licence: the address of a licence, or its SPDX identifier; if omitted, the crate states that no licence
        was given.
    title: of the crate; by default the names of the procedures.

    Raises
    ------
    RigctlError
        the path exists, a file of a run is missing or was changed, or the disk is full.
    """
    if path.exists():
        expected = "a new folder or .zip file"
        raise RigctlError("the path exists already", value=path.as_posix(), expected=expected)
    require_output(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        with write_error(path):
            files = _fill(draft, runs, licence, title)
            if path.suffix.lower() == ".zip":
                _pack(draft, path)
            else:
                draft.chmod(0o755)
                move_folder(draft, path)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return files


def _fill(folder: Path, runs: Sequence[Run], licence: str | None, title: str | None) -> int:
    graph: dict[str, Entity] = {}
    for run in runs:
        _add(graph, _run_entities(folder, run))
    datasets = [f"{run.id}/" for run in runs]
    people = [entity["@id"] for entity in graph.values() if entity["@type"] == "Person"]
    terms = _licence(licence)
    procedures = dict.fromkeys(str(run.info["procedure"]["name"]) for run in runs)
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": title or ", ".join(procedures),
        "description": _description(runs),
        "datePublished": max(str(run.info["ended"]) for run in runs)[:10],
        "license": _refer(terms["@id"]),
        "hasPart": [_refer(name) for name in datasets],
        "mentions": [_refer(f"#{run.id}") for run in runs],
        **({"author": [_refer(person) for person in people]} if people else {}),
    }
    head = {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": _refer(_PROFILE),
        "about": _refer("./"),
    }
    document = {"@context": f"{_PROFILE}/context", "@graph": [head, root, terms, *graph.values()]}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / METADATA).write_text(text + "\n", encoding="utf-8")
    return sum(1 for entity in graph.values() if entity["@type"] == "File")


def _description(runs: Sequence[Run]) -> str:
    """Describe the crate in one sentence."""
    benches = ", ".join(dict.fromkeys(str(run.info["rig"]["name"]) for run in runs))
    records = sum(int(run.info["records"]) for run in runs)
    return (
        f"{number_of(len(runs), 'run')} with {number_of(records, 'record')} on {benches}, recorded by rigctl"
    )


def _run_entities(folder: Path, run: Run) -> Iterable[Entity]:
    """Return the entities of one run: its files, its dataset, and the action that created it."""
    info, base = run.info, f"{run.id}/"
    (folder / run.id).mkdir()
    files = [*_copied(folder, run), *_sources(folder, run)]
    yield from files
    columns = list(_variables(run))
    yield from columns
    yield {
        "@id": base,
        "@type": "Dataset",
        "name": run.id,
        "identifier": run.id,
        "description": run.summary(),
        "dateCreated": info["ended"],
        "hasPart": [_refer(entity["@id"]) for entity in files],
        "variableMeasured": [_refer(entity["@id"]) for entity in columns],
    }
    made_with = list(_instruments(info))
    device, person = _device(info), _person(info)
    yield from made_with
    yield from (entity for entity in (device, person) if entity is not None)
    used = [f"{base}{name}.yaml" for name in ("procedure", "rig") if info[name]["text"]]
    finished = info["status"] == "finished"
    yield {
        "@id": f"#{run.id}",
        "@type": "CreateAction",
        "name": f"{info['procedure']['name']}, {info['started']}",
        "startTime": info["started"],
        "endTime": info["ended"],
        "actionStatus": _refer(f"http://schema.org/{'Completed' if finished else 'Failed'}ActionStatus"),
        **({"error": str(info["reason"])} if info.get("reason") else {}),
        "instrument": [_refer(entity["@id"]) for entity in made_with],
        "object": [_refer(name) for name in used] + ([_refer(device["@id"])] if device is not None else []),
        "result": _refer(base),
        **({"agent": _refer(person["@id"])} if person is not None else {}),
    }


def _copied(folder: Path, run: Run) -> Iterable[Entity]:
    """Copy the files of a run and compare them with the run's checksums."""
    for name in ("run.json", *run.info.get("files", ())):
        target = folder / run.id / name
        _fetch(run, name, target)
        facts = run_json.file_facts(target)
        recorded = run.info.get("files", {}).get(name)
        if recorded is not None and facts["sha256"] != recorded["sha256"]:
            raise RigctlError(
                "the file was changed since the run was closed",
                value=f"{shown_path(run.folder)}/{name}",
                hint=f"'rigctl runs verify {run.id}' says what can be saved",
                exit_code=ExitCode.FAILED,
            )
        yield _file(f"{run.id}/{name}", _FILES.get(name, name), facts)


def _fetch(run: Run, name: str, target: Path) -> None:
    """Copy one file of a run from its folder or from storage."""
    if not isinstance(run.folder, Path):
        with (run.folder / name).open() as source, target.open("wb") as copy:
            shutil.copyfileobj(source, copy)
        return
    where = Location(run.folder / name)
    try:
        source = open(run.folder / name, "rb", opener=regular)  # noqa: SIM115
    except FileNotFoundError as problem:
        raise RigctlError("a file of the run is missing", where=where, exit_code=ExitCode.FAILED) from problem
    except OSError as problem:
        raise RigctlError(
            f"cannot read the file: {problem.strerror}", where=where, exit_code=ExitCode.FAILED
        ) from problem
    with source, target.open("wb") as copy:
        shutil.copyfileobj(source, copy)


def _sources(folder: Path, run: Run) -> Iterable[Entity]:
    """Write the procedure and the rig file, verbatim."""
    for name, about in (("procedure", "What was carried out"), ("rig", "The bench and its calibrations")):
        source = run.info[name]
        if not source["text"]:
            continue
        content = source["text"].encode("utf-8")
        (folder / run.id / f"{name}.yaml").write_bytes(content)
        facts = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
        yield _file(f"{run.id}/{name}.yaml", f"{about}: {source['name']}", facts)


def _file(at: str, about: str, facts: Mapping[str, Any]) -> Entity:
    return {
        "@id": at,
        "@type": "File",
        "name": at.rpartition("/")[2],
        "description": about,
        "encodingFormat": _FORMATS.get(Path(at).suffix, "application/octet-stream"),
        "contentSize": str(facts["bytes"]),
        "sha256": facts["sha256"],
    }


def _variables(run: Run) -> Iterable[Entity]:
    """Return every column of the samples with its unit, and the sensor of a channel."""
    layout, calibrations = run.layout, run.info.get("calibrations", {})
    for name, unit in zip(layout.columns, layout.units, strict=True):
        sensor = calibrations.get(name, {})
        calibration = sensor.get("calibration") or {}
        facts = {
            "description": "an actuator's command" if name in layout.commands else None,
            "unitText": unit if unit != "1" else None,
            "unitCode": _UNIT_CODES.get(unit),
            "measurementTechnique": calibration.get("reference") or None,
        }
        yield {
            "@id": f"#{run.id}-{name}",
            "@type": "PropertyValue",
            "name": name,
            "propertyID": sensor.get("quantity", name),
            **{key: value for key, value in facts.items() if value is not None},
        }


def _instruments(info: Mapping[str, Any]) -> Iterable[Entity]:
    """Return the bench and the recording program."""
    rig, backend = info["rig"], info.get("backend", {})
    yield {
        "@id": f"#bench-{slug(str(rig['name']))}-{rig['sha256'][:12]}",
        "@type": "IndividualProduct",
        "name": str(rig["name"]),
        "description": ", ".join(f"{key} {value}" for key, value in backend.items()),
        **({"serialNumber": str(backend["serial"])} if backend.get("serial") else {}),
    }
    version = str(info.get("versions", {}).get("rigctl", ""))
    yield {
        "@id": f"{_RIGCTL}-{version}" if version else _RIGCTL,
        "@type": "SoftwareApplication",
        "name": "rigctl",
        **({"softwareVersion": version} if version else {}),
    }


def _device(info: Mapping[str, Any]) -> Entity | None:
    """Return the device under test; None if it is unknown."""
    device = info.get("device") or {}
    if not device:
        return None
    named = {"serial_number": "serialNumber", "part": "model", "notes": "description"}
    label = " ".join(device[key] for key in ("part", "serial_number") if key in device)
    return {
        "@id": f"#device-{slug(label)}-{hashlib.sha256(json.dumps(device).encode()).hexdigest()[:8]}",
        "@type": "IndividualProduct",
        "name": label or "device under test",
        **{named[key]: value for key, value in device.items() if key in named},
    }


def _person(info: Mapping[str, Any]) -> Entity | None:
    name = str(info.get("operator") or "").strip()
    if not name:
        return None
    return {
        "@id": f"#person-{slug(name)}-{hashlib.sha256(name.encode()).hexdigest()[:8]}",
        "@type": "Person",
        "name": name,
    }


def _licence(given: str | None) -> Entity:
    """Return the licence: an address, an SPDX identifier, or the statement that none was given.

    Raises
    ------
    RigctlError
        the licence is neither an address nor an identifier.
    """
    if given is None:
        return {
            "@id": _NO_LICENCE,
            "@type": "CreativeWork",
            "name": "no licence given",
            "description": "Nobody has said under which terms these data may be used: ask who gave them.",
        }
    if re.fullmatch(r"https?://\S+", given):
        return {"@id": given, "@type": "CreativeWork", "name": given}
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.+-]*", given):
        return {"@id": f"https://spdx.org/licenses/{given}", "@type": "CreativeWork", "name": given}
    raise RigctlError(
        "no licence", value=given, expected="an SPDX identifier such as CC-BY-4.0, or the address of its text"
    )


def _add(graph: dict[str, Entity], entities: Iterable[Entity]) -> None:
    """Add entities; a person, bench or program shared by several runs is added once."""
    for entity in entities:
        graph.setdefault(entity["@id"], entity)


def _refer(to: str) -> Entity:
    return {"@id": to}


def _pack(folder: Path, path: Path) -> None:
    """Write the folder as a ZIP file, the metadata first."""
    with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*"), key=lambda one: (one.name != METADATA, str(one))):
            if file.is_file():
                archive.write(file, file.relative_to(folder).as_posix())
