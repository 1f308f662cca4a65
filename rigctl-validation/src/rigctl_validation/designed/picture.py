"""A calibration plot of the predicted power: the share of pairs distinguished over the predicted probability.

``python -m rigctl_validation.designed.picture design.jsonl... -o predicted-power.svg`` draws the trials of
several files, of any version; `rigctl validate --tier design` those that it has carried out.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from rigctl.files.write import write_text
from rigctl_validation.designed.rates import CalibrationBin, calibration_bins
from rigctl_validation.designed.trial import DesignTrial
from rigctl_validation.store import every_outcome

_SIDE, _LEFT, _TOP = 320.0, 64.0, 20.0
#: share below which a label is above its point
_LOW = 0.1
_WIDTH, _HEIGHT = _LEFT + _SIDE + 24.0, _TOP + _SIDE + 56.0


def calibration_svg(bins: Sequence[CalibrationBin]) -> str:
    """A square with the diagonal; each bin a point with its 95 % bounds and its number of pairs."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'width="{_WIDTH:g}" height="{_HEIGHT:g}" font-family="sans-serif" font-size="12">',
        "<title>Share of pairs distinguished over the predicted probability</title>",
        f'<rect width="{_WIDTH:g}" height="{_HEIGHT:g}" fill="#ffffff"/>',
        *_axes(),
        f'<path d="M{_x(0):g},{_y(0):g} L{_x(1):g},{_y(1):g}" stroke="#999999" stroke-dasharray="4 4"/>',
    ]
    for one in bins:
        parts += _point(one)
    return "\n".join([*parts, "</svg>", ""])


def _axes() -> Iterator[str]:
    yield (
        f'<rect x="{_x(0):g}" y="{_y(1):g}" width="{_SIDE:g}" height="{_SIDE:g}" fill="none" stroke="#333"/>'
    )
    for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        yield (
            f'<text x="{_x(share):g}" y="{_y(0) + 18:g}" text-anchor="middle" fill="#333333">'
            f"{share:.0%}</text>"
        )
        yield (
            f'<text x="{_x(0) - 8:g}" y="{_y(share) + 4:g}" text-anchor="end" fill="#333">{share:.0%}</text>'
        )
    yield (
        f'<text x="{_x(0.5):g}" y="{_y(0) + 42:g}" text-anchor="middle" fill="#111111">'
        "predicted probability that a pair is distinguished</text>"
    )
    yield (
        f'<text transform="translate(16,{_y(0.5):g}) rotate(-90)" text-anchor="middle" fill="#111111">'
        "share that was distinguished</text>"
    )


def _point(one: CalibrationBin) -> Iterator[str]:
    rate = one.rate
    x, y = _x(one.mean), _y(rate.value)
    yield f'<path d="M{x:.1f},{_y(rate.low):.1f} V{_y(rate.high):.1f}" stroke="#0072b2" stroke-width="1.5"/>'
    yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="#0072b2"/>'
    side, anchor = (8.0, "start") if one.mean < 0.8 else (-8.0, "end")
    below = 16.0 if rate.value > _LOW else -8.0  # not over the axis
    yield (
        f'<text x="{x + side:.1f}" y="{y + below:.1f}" text-anchor="{anchor}" fill="#111111">'
        f"{one.achieved} of {one.pairs}</text>"
    )


def _x(share: float) -> float:
    return _LEFT + share * _SIDE


def _y(share: float) -> float:
    return _TOP + (1.0 - share) * _SIDE


def main() -> None:
    """Draw the trials of some files."""
    parser = argparse.ArgumentParser(description="Draw achieved over predicted power.")
    parser.add_argument("files", nargs="+", type=Path, help="of trials, as --tier design keeps them")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    outcomes = [one for path in options.files for one in every_outcome(path, DesignTrial.read)]
    write_text(options.output, calibration_svg(tuple(calibration_bins(outcomes))))


if __name__ == "__main__":
    main()
