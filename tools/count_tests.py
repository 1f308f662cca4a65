"""Counts the tests in pytest's JUnit files, one for each folder, as a table for the documentation.

    python tools/count_tests.py REPORT.xml …

Each test that failed or did not run is named, or its reason is, with how many have it.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path


def counted(report: Path) -> tuple[Counter[str], list[str], Counter[str]]:
    """Outcomes of the tests in one file, the names of those that failed, and why others did not run."""
    outcomes, failed, reasons = Counter[str](), list[str](), Counter[str]()
    for case in ET.parse(report).iter("testcase"):
        skipped = case.find("skipped")
        if skipped is not None:
            outcomes["skipped"] += 1
            reasons[skipped.get("message", "")] += 1
        elif case.find("failure") is not None or case.find("error") is not None:
            outcomes["failed"] += 1
            failed.append(f"{case.get('classname')}::{case.get('name')}")
        else:
            outcomes["passed"] += 1
    return outcomes, failed, reasons


def main(reports: list[Path]) -> None:
    """Print the table, the failures and the reasons."""
    total, why = Counter[str](), Counter[str]()
    lines, failures = ["| tests | passed | failed | not run there |", "|---|---|---|---|"], list[str]()
    for report in reports:
        if not report.exists():
            lines.append(f"| `{report.stem.replace('-', '/')}` | no result | | |")
            continue
        outcomes, failed, reasons = counted(report)
        total, why = total + outcomes, why + reasons
        failures += failed
        numbers = (outcomes[one] for one in ("passed", "failed", "skipped"))
        lines.append(f"| `{report.stem.replace('-', '/')}` | {' | '.join(map(str, numbers))} |")
    every = total.total() or 1
    share = f"{total['passed']} ({total['passed'] / every:.1%})"
    lines.append(f"| {every} | {share} | {total['failed']} | {total['skipped']} |")
    lines += ["", *(f"- failed: `{name}`" for name in failures)]
    lines += [f"- not run there, {number}: {reason}" for reason, number in why.most_common()]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
