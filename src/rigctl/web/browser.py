"""Opens the browser without revealing the token to other users of the computer."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from html import escape
from pathlib import Path


def can_open() -> bool:
    """Whether there is a screen on which a browser could be shown."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_browser(address: str) -> None:
    """Open an address in the user's browser, in the background; does nothing if there is none.

    Every user of a computer can see the arguments of programs. The browser is therefore given a file that
    only this user can read and that redirects to the address.
    """
    with suppress(OSError):
        page = _leading_page(address)
        threading.Thread(target=_open, args=(page,), name="browser", daemon=True).start()


def _leading_page(address: str) -> Path:
    from tempfile import mkdtemp

    page = Path(mkdtemp(prefix="rigctl-")) / "open.html"  # a folder of this user's alone
    quoted = escape(address, quote=True)
    page.write_text(
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>rigctl</title>'
        f'<meta http-equiv="refresh" content="0; url={quoted}"></head>'
        f'<body><a href="{quoted}">rigctl</a></body></html>\n',
        encoding="utf-8",
    )
    page.chmod(0o600)
    return page


def _open(page: Path) -> None:
    import time
    import webbrowser

    with suppress(Exception):
        webbrowser.open(page.as_uri())
    time.sleep(20.0)  # a browser that is not running yet reads it only after its start
    with suppress(OSError):
        page.unlink()
        page.parent.rmdir()
