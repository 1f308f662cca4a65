"""`make test` repeats one or two tests that fail, and hides nothing else."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[1] / "tools" / "run_tests.py"
#: fails when it is run for the first time
ONCE = """
def test_{name}(request):
    place = request.path.with_name("{name}")
    seen = place.exists()
    place.touch()
    assert seen
"""
ALWAYS = "\ndef test_wrong():\n    assert False\n"
PASSES = "\ndef test_right():\n    pass\n"


@pytest.mark.parametrize(
    ("tests", "code", "flaky"),
    [
        (PASSES, 0, []),
        (PASSES + ONCE.format(name="a"), 0, ["a"]),
        (ONCE.format(name="a") + ONCE.format(name="b"), 0, ["a", "b"]),
        (ONCE.format(name="a") + ONCE.format(name="b") + ONCE.format(name="c"), 1, []),
        (PASSES + ALWAYS, 1, []),
        (ALWAYS + ONCE.format(name="a"), 1, []),
        ("import nothing_of_this_name\n", 2, []),
    ],
    ids=["none fails", "one", "two", "three", "always", "always and once", "no tests"],
)
def test_few_failures_are_repeated(tmp_path: Path, tests: str, code: int, flaky: list[str]) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    (tmp_path / "test_it.py").write_text(tests, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(TOOL), "-q"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stdout
    said = [line.split()[1] for line in done.stdout.splitlines() if line.startswith("FLAKY: ")]
    assert said == [f"test_it.py::test_{name}" for name in flaky]
