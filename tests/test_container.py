"""The container holds what `make demo` installs. It is not built here: a test asks no registry of images."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).parents[1]
LINES = re.sub(r"\\\n\s*", "", (ROOT / "Containerfile").read_text(encoding="utf-8")).splitlines()


def words(instruction: str, containing: str = "") -> list[str]:
    """The arguments of the first such instruction."""
    (line, *_) = [one for one in LINES if one.startswith(f"{instruction} ") and containing in one]
    return shlex.split(line)[1:]


def test_it_installs_every_distribution_that_make_demo_installs() -> None:
    """It lacked the separate benches, so that `rigctl validate` in it asked for them."""
    demo = re.search(r"/\.installed:.*?(?=\n\S)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.DOTALL)
    assert demo is not None
    wanted = {(ROOT / path).resolve() for path in re.findall(r"--editable (\S+)", demo.group())}
    copied, folder = words("COPY")
    assert (copied, folder) == (".", "/source")
    installed = [
        word.removesuffix("[all]") for word in words("RUN", "pip install") if word.startswith(folder)
    ]
    paths = [(ROOT / Path(word).relative_to(folder)).resolve() for word in installed]
    assert paths[0] == ROOT / "constraints.txt"
    assert set(paths[1:]) == wanted
    assert all((path / "pyproject.toml").is_file() for path in wanted)


def test_what_it_copies_and_starts_exists() -> None:
    """The second image takes the folder that the first has made, and starts its program."""
    source, target = words("COPY", "--from=build")[1:]
    assert source == target == words("RUN", "python -m venv")[3]
    assert any(word == f"{source}/bin/pip" for word in words("RUN", "pip install"))
    assert words("ENV") == [f"PATH={target}/bin:$PATH"]
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert words("ENTRYPOINT") == ["[rigctl]"]
    assert re.search(r"^rigctl = ", project, re.MULTILINE)
    assert re.search(r"^all = \[", project, re.MULTILINE)
