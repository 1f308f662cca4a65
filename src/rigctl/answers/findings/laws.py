"""The laws of effects in words: what the data support, beside what the library assumes."""

from __future__ import annotations

from rigctl.analysis.laws.answer import LawAnswer
from rigctl.units import with_uncertainty

#: an exponent with a larger standard deviation than this is hardly determined
_ROUGH = 0.4


def law_text(answer: LawAnswer) -> str:
    """``valve_leakage grows as pressure^(0.71 ± 0.02), not as pressure^1: …``."""
    return _no_exponent_text(answer) if answer.power is None else _exponent_text(answer)


def _over(answer: LawAnswer) -> str:
    name = answer.law.driver.name
    return name if name.isidentifier() else f"({name})"


def _exponent_text(answer: LawAnswer) -> str:
    name, over = answer.effect, _over(answer)
    n = with_uncertainty(answer.exponent, answer.exponent_std)
    assumed = answer.assumed_exponent
    if answer.constant:
        return (
            f"according to the data, the term at {answer.law.slot} does not change with {over}: the "
            f"exponent of {name} is {n} there, not {assumed:.3g}"
        )
    if assumed is None:
        text = f"{name} changes with {over} as its assumed law times {over}^({n})"
    else:
        verb = "grows" if answer.exponent > 0.0 else "falls"
        text = f"{name} {verb} as {over}^({n}), not as {over}^{assumed:.3g}"
    if answer.follows:
        return f"{text}: over the range of these data no further correction is needed"
    return f"{text}, approximately: no power law describes it completely, see the curve"


def _no_exponent_text(answer: LawAnswer) -> str:
    law, name, over = answer.law, answer.effect, _over(answer)
    if law.differs:
        return (
            f"the data support a law of {name} over {over} that differs from the assumed one, but do not "
            "determine a power: see the curve"
        )
    if answer.fitted:
        return f"the law of {name} over {over} is fitted, and the data show nothing beyond it"
    if not law.change_std < _ROUGH:
        return f"the data hardly determine the law of {name} over {over}"
    if answer.assumed_exponent is None:
        return (
            f"the data do not distinguish the law of {name} over {over} from the assumed one: "
            f"a further factor {over}^n would have n = {with_uncertainty(law.change, law.change_std)}"
        )
    return (
        f"the data do not distinguish the law of {name} from {over}^{answer.assumed_exponent:.3g}: its "
        f"exponent is {with_uncertainty(answer.exponent, law.change_std)}"
    )
