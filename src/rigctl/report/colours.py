"""The colours of curves, marks and spans, on the page and in files.

The style sheet of the page (``assets/page.css``) repeats them as ``--series-1`` to ``--series-8``, beside the
colours of text and ground.
"""

from __future__ import annotations

from typing import Final

#: colours of series, distinguishable for most colour-blind readers on light and dark backgrounds
SERIES: Final = ("#2f7fc1", "#d97a26", "#2f9e6e", "#b35fb0", "#c9504c", "#1f9aa8", "#8c6d46", "#7b8494")
#: colour of an event
MARK: Final = SERIES[4]
#: colour and opacity of a span of time behind the curves
SPAN: Final = "#6e8cb4"
SPAN_OPACITY: Final = 0.16
