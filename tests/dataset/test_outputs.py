from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.dataset import open_run
from rigctl.dataset.exporting import export_run
from rigctl.dataset.outputs import is_figure, is_page, require_folder, require_output
from rigctl.errors import RigctlError
from rigctl.report import write_report
from systems import needs_posix

RunMaker = Callable[..., Path]
PAGE = b'<!DOCTYPE html>\n<meta charset="utf-8">\n<meta name="generator" content="rigctl 0.1.0">\n'


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("name", ["samples.parquet", "run.json", "new.html", "deeper/new.html"])
def test_pages_and_exports_are_never_written_into_a_run(make_run: RunMaker, name: str, force: bool) -> None:
    folder = make_run()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    run = open_run(folder)
    with pytest.raises(RigctlError, match="into a run"):
        write_report([run], folder / name, force=force)
    with pytest.raises(RigctlError, match="into a run"):
        export_run(run, (folder / name).with_suffix(".csv"), overwrite=force)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@needs_posix("a link that every user may make")
def test_an_output_path_through_a_link_into_a_run_is_refused(make_run: RunMaker, tmp_path: Path) -> None:
    folder = make_run()
    link = tmp_path / "elsewhere"
    try:
        link.symlink_to(folder, target_is_directory=True)
    except OSError:
        pytest.fail("this system lets a test make no symbolic link")
    with pytest.raises(RigctlError, match="into a run"):
        require_output(link / "page.html", force=True)
    with pytest.raises(RigctlError, match="into a run"):
        require_folder(link / "effects")


def test_an_output_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine", encoding="utf-8")
    require_folder(tmp_path / "new" / "effects")
    for folder in ("notes", "notes/effects"):
        with pytest.raises(RigctlError, match="notes: a file is there; expected the name of a folder"):
            require_folder(tmp_path / folder)
    with pytest.raises(RigctlError, match="notes: a file is there; expected the name of a folder"):
        require_output(tmp_path / "notes" / "page.html", force=True)


@pytest.mark.parametrize(
    ("content", "replaced"), [(PAGE, True), (b"rig: mine\n", False), (b"", False), (b"<html></html>", False)]
)
def test_a_page_overwrites_only_another_page_unless_forced(
    make_run: RunMaker, tmp_path: Path, content: bytes, replaced: bool
) -> None:
    run, target = open_run(make_run()), tmp_path / "page.html"
    target.write_bytes(content)
    if replaced:
        write_report([run], target)
        assert is_page(target.read_bytes()[:4096])
        return
    with pytest.raises(RigctlError, match="another kind") as caught:
        write_report([run], target)
    assert "--force" in str(caught.value)
    assert target.read_bytes() == content
    write_report([run], target, force=True)
    assert is_page(target.read_bytes()[:4096])


def test_a_figure_overwrites_only_another_figure(make_run: RunMaker, tmp_path: Path) -> None:
    run, figures = open_run(make_run()), tmp_path / "figures"
    first = write_report([run], tmp_path / "page.html", figures=figures)
    write_report([run], tmp_path / "page.html", figures=figures)
    assert all(is_figure(path.read_bytes()) for path in first.figures)
    first.figures[0].write_text("my notes", encoding="utf-8")
    with pytest.raises(RigctlError, match="another kind"):
        write_report([run], tmp_path / "page.html", figures=figures)
    assert first.figures[0].read_text(encoding="utf-8") == "my notes"
