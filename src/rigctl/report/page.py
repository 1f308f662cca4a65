"""The page around the sections: one HTML file that needs no other file and cannot be made to fetch one.

The plots are drawn by plotly.js, whose unchanged basic bundle is in ``assets`` with its licence; its first
lines state its version. ``npm pack plotly.js-basic-dist-min`` fetches a newer one.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from markupsafe import Markup

from rigctl.answers.numbers import moment, plural
from rigctl.report.run_data import RunData
from rigctl.report.section import Section, render
from rigctl.report.words import words_in

_ASSETS = Path(__file__).parent / "assets"


def page(runs: Sequence[RunData], sections: Sequence[Section], timestamp: datetime | None = None) -> str:
    """The HTML of the page, ready to be written as UTF-8.

    Parameters
    ----------
    timestamp: time for the footer; by default now.
    """
    # The policy is made from the very scripts that are inserted: a browser runs only what has one of these
    # hashes.
    scripts = [_asset("plotly-basic.min.js"), _asset("page.js")]
    when = (timestamp or datetime.now(UTC)).isoformat(timespec="seconds")
    # A page with an answer is named after its model; one about runs after what was run.
    about = next((section.names_page for section in sections if section.names_page), "")
    return render(
        "page.html",
        title=about or title(runs),
        subtitle=f"on {title(runs)}, {subtitle(runs)}" if about else subtitle(runs),
        sections=sections,
        words=words_in(" ".join(str(section.body) for section in sections)) if about else {},
        contents=not about,  # on a page with an answer the folded titles are the table of contents
        policy=policy(scripts),
        style=Markup(_asset("page.css")),  # noqa: S704 - a file of this package
        scripts=[Markup(script) for script in scripts],  # noqa: S704 - files of this package
        version=_version(),
        made=moment(when),
    )


def title(runs: Sequence[RunData]) -> str:
    """The procedures that were run."""
    names = dict.fromkeys(str(run.info.get("procedure", {}).get("name") or run.id) for run in runs)
    return ", ".join(names)


def subtitle(runs: Sequence[RunData]) -> str:
    """The bench, when and by whom; for several runs the bench and their number."""
    rigs = ", ".join(dict.fromkeys(str(run.info.get("rig", {}).get("name") or "") for run in runs))
    on = f"on {rigs}" if rigs else ""
    if len(runs) > 1:
        return " ".join(filter(None, (plural(len(runs), "run"), on)))
    info = runs[0].info
    started = moment(info.get("started")) if info.get("started") else ""
    by = f"by {info['operator']}" if info.get("operator") else ""
    return ", ".join(filter(None, (on, started, by)))


def policy(scripts: Sequence[str]) -> str:
    """A content security policy: only these scripts run, and nothing is fetched from anywhere.

    It protects even if a text from a user's file should get into the page unescaped.
    """
    hashes = " ".join(f"'sha256-{_sha256(script)}'" for script in scripts)
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src {hashes}",
            "style-src 'unsafe-inline'",  # plotly.js sizes its parts by style attributes
            "img-src data: blob:",  # a plot that is saved as an image
            "base-uri 'none'",
            "form-action 'none'",
        )
    )


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


@lru_cache(maxsize=4)
def _asset(name: str) -> str:
    """A file of the page with line ends as a browser sees them, on which the policy's hashes depend."""
    return (_ASSETS / name).read_text(encoding="utf-8")


def _version() -> str:
    try:
        return version("rigctl")
    except PackageNotFoundError:
        return "unknown"
