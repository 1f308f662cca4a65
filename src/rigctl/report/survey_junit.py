"""A survey as test cases in JUnit's XML, for schedulers and build servers: a case for each quantity."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from rigctl.analysis.decision_levels import SURVEY_ALPHA
from rigctl.answers.survey import sentence, statement
from rigctl.dataset.exporting.junit import element, plain
from rigctl.files.write import write_error
from rigctl.monitoring.result import Survey


def write_junit(survey: Survey, path: Path) -> int:
    """Write the survey as one suite, and return its number of cases.

    A change is a failure, a run that could not be read an error; a quantity that could not be tested, or for
    which there are too few runs, is skipped, so that it never looks as if it had passed.

    Raises
    ------
    RigctlError
        the file cannot be written.
    """
    suites = ET.Element("testsuites")
    changed = {change.quantity.name: sentence(survey, change) for change in survey.changes}
    tested = survey.judged.tested
    names = list(dict.fromkeys([*changed, *(one.course.quantity.name for one in tested)]))
    able = {one.course.quantity.name for one in tested if one.found is not None}
    skipped = [n for n in names if n not in changed and (n not in able or survey.verdict == "cannot_tell")]
    suite = element(
        suites,
        "testsuite",
        name=f"survey of {survey.model}",
        package="rigctl.survey",
        id=0,
        hostname="localhost",
        tests=len(names) + len(survey.failed),
        failures=len(changed),
        errors=len(survey.failed),
        skipped=len(skipped),
        time="0.000",
    )
    properties = element(suite, "properties")
    facts = {"verdict": survey.verdict, "level": f"{SURVEY_ALPHA:g}", "runs": str(len(survey.read))}
    for key, value in facts.items():
        element(properties, "property", name=key, value=value)
    for name in names:
        case = element(suite, "testcase", classname="survey", name=name, time="0.000")
        if name in changed:
            failure = element(case, "failure", type="changed", message=changed[name])
            failure.text = plain(changed[name])
        elif name in skipped:
            element(case, "skipped", message="these runs cannot tell")
    for line in survey.failed:
        case = element(suite, "testcase", classname="survey.runs", name=line.entry.label, time="0.000")
        element(case, "error", type="unread", message=line.failed)
    element(suite, "system-out").text = plain(statement(survey))
    element(suite, "system-err").text = ""
    ET.indent(suites)
    with write_error(path):
        ET.ElementTree(suites).write(path, encoding="utf-8", xml_declaration=True)
    return len(names) + len(survey.failed)
