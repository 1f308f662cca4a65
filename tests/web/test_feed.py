"""The reading of a run for all windows that watch it."""

from __future__ import annotations

from pathlib import Path
from time import monotonic
from types import SimpleNamespace
from typing import cast

import pytest

from dataset.strokes import LAYOUT, STARTED
from rigctl.dataset import RunHeader, RunWriter, Source
from rigctl.web import feed as reading
from rigctl.web.feed import Feed
from rigctl.web.live import Live
from rigctl.web.server_state import Site


def test_a_window_that_is_about_to_join_keeps_a_feed_that_nobody_watches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A feed that ended between being found and being joined left its window without any further news."""
    monkeypatch.setattr(reading, "_LINGER", 1e9)  # it does not end while it is looked at here
    header = RunHeader("20261121-093000-stroke", Source("stroke"), Source("bench"), LAYOUT, STARTED, {})
    writer = RunWriter.create(tmp_path, header)
    feed = Feed(writer.close("finished"), header)
    live = Live(cast("Site", SimpleNamespace(at_end=[])))
    live._feeds[writer.id] = feed
    began = monotonic()
    feed._asked = began - 1e6
    assert live.feed(writer.id) is feed
    assert feed._asked >= began


def test_a_feed_that_has_ended_does_not_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_LINGER", -1.0)
    header = RunHeader("20261121-093000-stroke", Source("stroke"), Source("bench"), LAYOUT, STARTED, {})
    feed = Feed(RunWriter.create(tmp_path, header).close("finished"), header)
    feed._thread.join(60.0)
    assert not feed.goes_on()
