"""The measures of a run as test cases in JUnit XML, for build servers and test management.

The format has no single standard: only what the schemas of Ant and Jenkins have in common is used. A suite is
one run; each measure with limits is a case, and so is the completion of the run, so that an aborted run can
never look as if everything had passed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree as ET

from rigctl.dataset.history import TakenMeasure
from rigctl.dataset.pass_fail import Judged, judge_run, taken_in
from rigctl.dataset.run_id import slug
from rigctl.files.write import write_error
from rigctl.units import show

if TYPE_CHECKING:
    from rigctl.dataset.run import Run

#: characters that XML 1.0 does not allow, escaped or not
_NOT_XML: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write(run: Run, path: Path) -> int:
    """Write a run's measures as one suite, and return its number of cases.

    Raises
    ------
    RigctlError
        a file of the run is missing or damaged, or the output cannot be written.
    """
    suites = ET.Element("testsuites")
    cases = _suite(suites, run)
    ET.indent(suites)
    with write_error(path):
        ET.ElementTree(suites).write(path, encoding="utf-8", xml_declaration=True)
    return cases


def _suite(suites: ET.Element, run: Run) -> int:
    judged = judge_run(run).measures
    ended = run.info["status"] == "finished"
    name = str(run.info["procedure"]["name"])
    counts = {
        "tests": len(judged) + 1,
        "failures": sum(not measure.passed for measure in judged),
        "errors": int(not ended),
        "skipped": 0,
    }
    suite = element(
        suites,
        "testsuite",
        name=name,
        package=slug(str(run.info["rig"]["name"])),
        id=0,
        hostname="localhost",  # the schema's value for an unknown host
        timestamp=utc(run.info["started"]),
        time=f"{run.info['duration']:.3f}",
        **counts,
    )
    properties = element(suite, "properties")
    for key, value in _facts(run.info).items():
        element(properties, "property", name=key, value=value)
    case = element(suite, "testcase", classname=slug(name), name="run", time=f"{run.info['duration']:.3f}")
    if not ended:
        element(case, "error", type=run.info["status"], message=run.info.get("reason") or run.info["status"])
    for measure in judged:
        _case(suite, slug(name), measure)
    element(suite, "system-out").text = plain(_all_values(taken_in(run)))
    element(suite, "system-err").text = ""
    return len(judged) + 1


def _case(suite: ET.Element, procedure: str, measure: Judged) -> None:
    """Make the case of one measure; the path of its step distinguishes measures of the same name."""
    value = measure.taken.value
    group = f"{procedure}.{slug(measure.record)}" if measure.record is not None else procedure
    index = f" (record {measure.taken.record})" if measure.record is not None else ""
    step = f" at {value.path}" if value.path else ""
    case = element(suite, "testcase", classname=group, name=f"{value.name}{index}{step}", time="0.000")
    if not measure.passed:
        sentence = measure.sentence()
        element(case, "failure", type="limit", message=sentence).text = plain(sentence)


def _facts(info: Any) -> dict[str, str]:
    """Return the properties of the report: the device, the operator, the bench and the version."""
    facts = {
        "run": info["id"],
        "status": info["status"],
        **info.get("device", {}),
        "operator": info.get("operator", ""),
        "rig": info["rig"]["name"],
        **{f"bench.{name}": value for name, value in info.get("backend", {}).items()},
        **{f"argument.{name}": value for name, value in info.get("arguments", {}).items()},
        "rigctl": info.get("versions", {}).get("rigctl", ""),
    }
    return {name: str(value) for name, value in facts.items() if value}


def _all_values(measures: Sequence[TakenMeasure]) -> str:
    """Return every measured value, one per line, including those without limits."""
    lines = []
    for taken in measures:
        value = taken.value
        at = "run" if taken.record < 0 else f"record {taken.record}"
        lines.append(f"{at}: {value.name} = {show(value.value, value.unit, difference=value.difference)}")
    return "\n".join(lines)


def element(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Make an XML element; characters that XML does not allow are replaced."""
    return ET.SubElement(parent, tag, {name: plain(str(value)) for name, value in attributes.items()})


def plain(text: str) -> str:
    """Return a text without characters that XML does not allow."""
    return _NOT_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def utc(written: str) -> str:
    """Format a calendar time as in the schema: UTC, to the second, without the zone."""
    return f"{datetime.fromisoformat(written).astimezone(UTC):%Y-%m-%dT%H:%M:%S}"
