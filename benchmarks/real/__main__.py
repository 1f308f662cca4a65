"""Make the tables of the real logs: ``python -m benchmarks.real downloads -o real-data``."""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.real.prepare import LOGS


def main() -> None:
    """Write or check the tables of some logs, by default of all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real", description=__doc__)
    parser.add_argument("source", type=Path, help="folder with the published files")
    parser.add_argument("logs", nargs="*", help=f"of {', '.join(LOGS)}; all by default")
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("real-data"), help="a new folder for the tables"
    )
    parser.add_argument("--check", type=Path, metavar="FOLDER", help="compare with these tables instead")
    options = parser.parse_args()
    chosen = options.logs or list(LOGS)
    if options.check is None:
        if options.out.exists():
            raise SystemExit(f"{options.out} exists already; '-o' names another folder")
        _make(options.source, options.out, chosen)
        return
    with TemporaryDirectory() as folder:
        made = Path(folder) / "made"
        _make(options.source, made, chosen)
        raise SystemExit(_compared(made, options.check))


def _make(source: Path, out: Path, logs: list[str]) -> None:
    for name in logs:
        LOGS[name](source, out)
        print(f"{out / name}")


def _compared(made: Path, kept: Path) -> int:
    """Print every table that differs; the number of these."""
    paths = sorted(made.rglob("*.csv"))
    other = [path.relative_to(made) for path in paths if not _same(path, kept / path.relative_to(made))]
    print(f"{len(paths) - len(other)} tables are the same" + "".join(f"\n{path} differs" for path in other))
    return len(other)


def _same(one: Path, other: Path) -> bool:
    return other.exists() and one.read_text(encoding="utf-8") == other.read_text(encoding="utf-8")


if __name__ == "__main__":
    main()
