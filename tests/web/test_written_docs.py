"""The documentation of a checkout in which the site was not built."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from rigctl.errors import RigctlError
from rigctl.web import docs
from rigctl.web.request_handling import PageRequest


def test_a_checkout_without_the_site_shows_the_pages_as_they_are_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(docs, "site_folder", lambda: None)
    pages = {one["path"]: one["title"] for one in docs.written_pages()}
    assert pages["tutorial/first-run.md"] == "A first run"
    assert len(pages) > 40
    for path in pages:
        reply = docs.page(cast("PageRequest", SimpleNamespace(text=lambda _, path=path: path)))
        assert bytes(reply.body).startswith(b"# ")
        assert reply.media_type == "text/plain; charset=utf-8"
    for path in ("../README.md", "nothing.md", ""):
        with pytest.raises(RigctlError, match="no such page"):
            docs.page(cast("PageRequest", SimpleNamespace(text=lambda _, path=path: path)))
