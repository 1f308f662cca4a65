"""Runs the tests, and once more the few that fail: ``python tools/run_tests.py [arguments of pytest]``.

Of 9000 tests, many of which run whole programs beside each other, one may fail by a race that is seldom seen.
If at most `MOST` fail and all of them pass when nothing else runs, the exit code is 0, and each is named on
the last lines: somebody has to find that race, in the test or in rigctl. A fault that is there whenever its
test runs fails again. CPython's own tests are run in this way (``regrtest --rerun``).
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

#: more failures than this are no accident
MOST = 2
#: pytest's exit code if tests have failed, and nothing else has gone wrong
_FAILED = 1


def main(arguments: list[str]) -> int:
    """The exit code."""
    code = _pytest("--cache-clear", *arguments)
    kept = Path(".pytest_cache/v/cache/lastfailed")
    failed = sorted(json.loads(kept.read_text("utf-8"))) if code == _FAILED and kept.is_file() else []
    if not 0 < len(failed) <= MOST:
        return code
    print(f"\nonce more, alone: {', '.join(failed)}", flush=True)
    for test in failed:
        if again := _pytest("-p", "no:cacheprovider", test):
            return again
    for test in failed:
        print(f"FLAKY: {test} failed, and passed when it was repeated alone: find out why")
    return 0


def _pytest(*arguments: str) -> int:
    return subprocess.run([sys.executable, "-m", "pytest", *arguments], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
