"""Cases in which one of several rival models made the data: what GPdoemd's authors try their designs on.

A case is what a user would write: a rig file, and a family file for each rival, with the equations in
rigctl's formulas. The data come from `Case.truth`, which computes the right model with NumPy and SciPy and
shares nothing with rigctl. Constants, ranges, noise and bounds are those of the case studies that come with
GPdoemd (S. Olofsson, M. P. Deisenroth, R. Misener, ICML 2018; S. Olofsson et al., Computers & Chemical
Engineering 125 (2019) 54), which name their own sources; a lower bound of zero is a millionth of the upper
one here, since a parameter at zero may make a formula undefined.

Left out: the two cases of differential equations, of which one experiment is a single reading at a chosen
time; a record of rigctl has all its readings, and one record would answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import exp1

Floats = NDArray[np.float64]

#: lower bounds of zero, as a share of the upper one
_ZERO = 1e-6


@dataclass(frozen=True)
class Rival:
    """One of the models: its formula for each reading, and (start, low, high) of its parameters."""

    formulas: Mapping[str, str]
    parameters: Mapping[str, tuple[float, float, float]]
    tables: str = ""


@dataclass(frozen=True)
class Case:
    """Rivals, and a process that follows one of them.

    Attributes
    ----------
    ranges: of what can be set; None for a switch.
    noise: standard deviation of each reading.
    right: the name of the rival that the process follows.
    truth: (n, settings) to (n, readings), without noise.
    first: number of experiments at random settings before any is designed.
    more: most experiments that may be added.
    """

    name: str
    title: str
    source: str
    ranges: Mapping[str, tuple[float, float] | None]
    noise: Mapping[str, float]
    rivals: Mapping[str, Rival]
    right: str
    truth: Callable[[Floats], Floats]
    first: int
    more: int = 20

    def settings_at_random(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, settings) uniform over the ranges; of a switch half are on."""
        columns = [
            rng.permutation(np.arange(count) % 2).astype(float)
            if span is None
            else rng.uniform(*span, size=count)
            for span in self.ranges.values()
        ]
        return np.column_stack(columns)

    def measure(self, settings: Floats, rng: np.random.Generator) -> Floats:
        """(n, readings) with noise."""
        exact = self.truth(settings)
        return exact + rng.normal(size=exact.shape) * np.array(list(self.noise.values()))

    def write(self, folder: Path) -> list[Path]:
        """The rig file, the family files and the model files of the rivals, whose paths are returned."""
        first = next(iter(self.rivals))
        (folder / "rig.yaml").write_text(self._rig(first), encoding="utf-8")
        models = []
        for name, rival in self.rivals.items():
            (folder / f"family-{name}.yaml").write_text(self._family(name, rival), encoding="utf-8")
            free = [f"  {each}: {{value: {at[0]!r}, fit: true}}" for each, at in rival.parameters.items()]
            lines = [f"model: family-{name}.yaml", "rig: rig.yaml", "parameters:", *free, ""]
            models.append(folder / f"{name}.yaml")
            models[-1].write_text("\n".join(lines), encoding="utf-8")
        return models

    def _rig(self, family: str) -> str:
        channels = [
            f'  {name}: {{unit: "1", quantity: other, noise: {sigma!r}}}'
            for name, sigma in self.noise.items()
        ]
        actuators = [
            f"  {name}: {{kind: switch}}"
            if span is None
            else f'  {name}: {{kind: level, unit: "1", low: {span[0]!r}, high: {span[1]!r}}}'
            for name, span in self.ranges.items()
        ]
        rest = [f"  {name}: {'off' if span is None else repr(span[0])}" for name, span in self.ranges.items()]
        head = [f"name: {self.name}", f"model: family-{family}.yaml", "channels:", *channels]
        return "\n".join([*head, "actuators:", *actuators, "safe_state:", *rest, ""])

    def _family(self, name: str, rival: Rival) -> str:
        inputs = [
            f"  {each}: {{value: {0.0 if span is None else 0.5 * sum(span)!r}, meaning: set}}"
            for each, span in self.ranges.items()
        ]
        parameters = [
            f"  {each}: {{value: {start!r}, bounds: [{low!r}, {high!r}], meaning: fitted}}"
            for each, (start, low, high) in rival.parameters.items()
        ]
        outputs = [
            f'  {each}: {{unit: "1", formula: "{formula}"}}' for each, formula in rival.formulas.items()
        ]
        head = [f"family: {name.lower()}", f"title: rival {name} of {self.name}", "inputs:", *inputs]
        return "\n".join([*head, "parameters:", *parameters, rival.tables, "outputs:", *outputs, ""])


def table(columns: Sequence[str], rows: Floats) -> str:
    """The text of a CSV file."""
    lines = [",".join(f"{value:.10g}" for value in row) for row in rows]
    return "\n".join([",".join(columns), *lines, ""])


def _bounded(starts: Mapping[str, float], highs: Sequence[float]) -> dict[str, tuple[float, float, float]]:
    return {
        name: (start, _ZERO * high, high) for (name, start), high in zip(starts.items(), highs, strict=True)
    }


# --- synthesis of methanol: five rate laws with five constants each


def _methanol_truth(settings: Floats) -> Floats:
    x1, x2, x3 = settings.T
    denominator = 1704.0 + 4.25 * x2 + 0.241 * x1 * x2 + 444.6 * x3
    return np.asarray((x1 * x2**2 - x3 / 1.7e-5) / denominator**2)[:, None]


def _methanol() -> Case:
    driving = "(x1*x2^2 - x3/keq)"
    constants = _bounded(
        {"k1": 1000.0, "k2": 1.0, "k3": 0.1, "k4": 100.0, "keq": 1e-4}, (1e4, 10.0, 1.0, 1e3, 1.0)
    )
    formulas = {
        "M1": f"{driving}/(k1 + k2*x1 + k3*x2 + k4*x3)^2",
        "M2": f"{driving}/(k1 + k2*x1 + k3*x2 + k4*x1*x2)",
        "M3": f"{driving}/(x2^2*(k1 + k2*x3 + k3*x2) + k4*x2*x3)",
        "M4": f"{driving}/(x2*(k1 + k2*x1 + k3*x3/x2 + k4*x3)^2)",
        "M5": f"{driving}/(k1 + k2*x2 + k3*x1*x2 + k4*x3)^2",
    }
    return Case(
        "bff1983",
        "methanol synthesis",
        "G. Buzzi-Ferraris, P. Forzatti, Chem. Eng. Sci. 38 (1983) 225",
        {"x1": (15.0, 25.0), "x2": (200.0, 250.0), "x3": (5.0, 10.0)},
        {"y": 4e-7**0.5},
        {name: Rival({"y": formula}, constants) for name, formula in formulas.items()},
        "M5",
        _methanol_truth,
        first=8,
    )


# --- two rates of one reaction: four rivals with four constants each


def _two_rates_truth(settings: Floats) -> Floats:
    a, b = settings.T
    return np.asarray(np.array([0.1, 0.01]) * (a * b / (1.0 + 0.1 * a + 0.01 * b))[:, None])


def _two_rates() -> Case:
    constants = {
        name: (start, 1e-4, 1.0) for name, start in (("k1", 0.05), ("k2", 0.05), ("k3", 0.05), ("k4", 0.05))
    }
    both, one, other = "(1 + k3*x1 + k4*x2)", "(1 + k3*x1)", "(1 + k4*x1)"
    formulas = {
        "M1": (f"k1*x1*x2/{both}", f"k2*x1*x2/{both}"),
        "M2": (f"k1*x1*x2/{both}^2", f"k2*x1*x2/{one}^2"),
        "M3": ("k1*x1*x2/(1 + k3*x2)^2", f"k2*x1*x2/{other}^2"),
        "M4": (f"k1*x1*x2/{both}", f"k2*x1*x2/{one}"),
    }
    return Case(
        "bffeh1984",
        "two rates of a reaction",
        "G. Buzzi-Ferraris, P. Forzatti, G. Emig, H. Hofmann, Chem. Eng. Sci. 39 (1984) 81",
        {"x1": (5.0, 55.0), "x2": (5.0, 55.0)},
        {"y1": 0.35**0.5, "y2": 2.3e-3**0.5},
        {name: Rival({"y1": y1, "y2": y2}, constants) for name, (y1, y2) in formulas.items()},
        "M1",
        _two_rates_truth,
        first=5,
    )


# --- a reaction in a tubular or in a stirred reactor: of order 0, 1 or 2, mixed on a small or a large scale


def _reactors(order: int, large: bool, rate: float) -> Callable[[Floats], Floats]:
    """Share of the reactant that is left, in a stirred reactor (0) or a tube (1)."""

    def left(settings: Floats) -> Floats:
        time, start, tube = settings.T
        r = rate * time * start ** (order - 1.0)
        if order == 0:
            in_tube = np.maximum(1.0 - r, 0.0)
            stirred = 1.0 - r + r * np.exp(-1.0 / r) if large else in_tube
        elif order == 1:
            in_tube, stirred = np.exp(-r), 1.0 / (1.0 + r)
        else:
            in_tube = 1.0 / (1.0 + r)
            stirred = (
                np.exp(1.0 / r) * exp1(1.0 / r) / r if large else (np.sqrt(1.0 + 4.0 * r) - 1.0) / (2.0 * r)
            )
        return np.where(tube > 0.5, in_tube, stirred)[:, None]

    return left


def _segregated() -> str:
    """``exp(1/r)·E1(1/r)/r`` over ln r as a curve through points: formulas have no exponential integral."""
    at = np.linspace(-9.0, 2.5, 93)
    r = np.exp(at)
    value = exp1(1.0 / np.maximum(r, 2e-3)) * np.exp(1.0 / np.maximum(r, 2e-3)) / np.maximum(r, 2e-3)
    asymptotic = 1.0 - r + 2.0 * r**2 - 6.0 * r**3  # where the exponential overflows
    points = ", ".join(
        f"[{x:.6g}, {y:.9g}]" for x, y in zip(at, np.where(r < 2e-3, asymptotic, value), strict=True)
    )
    return f'tables:\n  segregated: {{over: "1", unit: "1", points: [{points}]}}'


def mixing(right: str = "M3") -> Case:
    """The case with any of its rivals as the right one."""
    stirred, tube = "(1 - tube)", "tube"
    zero, first, second = "k*tau/c0", "k*tau", "k*tau*c0"
    falls = f"positive_part(1 - {zero}, 0.0001)"
    formulas = {
        "M1": falls,
        "M2": f"{stirred}*(1 - {zero} + {zero}*exp(-1/({zero}))) + {tube}*{falls}",
        "M3": f"{stirred}/(1 + {first}) + {tube}*exp(-{first})",
        "M4": f"{stirred}*(sqrt(1 + 4*{second}) - 1)/(2*{second}) + {tube}/(1 + {second})",
        "M5": f"{stirred}*table(log({second}), segregated) + {tube}/(1 + {second})",
    }
    truths = {
        "M1": _reactors(0, False, 0.006),
        "M2": _reactors(0, True, 0.006),
        "M3": _reactors(1, False, 0.015),
        "M4": _reactors(2, False, 0.025),
        "M5": _reactors(2, True, 0.025),
    }
    return Case(
        f"mixing-{right}",
        f"reaction order and mixing, {right} right",
        "S. Olofsson et al., Comput. Chem. Eng. 125 (2019) 54",
        {"tau": (1.0, 100.0), "c0": (0.01, 1.0), "tube": None},
        {"y": 0.05},
        {
            name: Rival({"y": formula}, {"k": (0.01, 1e-6, 0.1)}, _segregated() if name == "M5" else "")
            for name, formula in formulas.items()
        },
        right,
        truths[right],
        first=4,
    )


# --- a sum of one to four terms: every rival contains the ones before it


def _terms_truth(settings: Floats) -> Floats:
    (x,) = settings.T
    return np.asarray(-x + 0.5 * x**2 - 6.0 * np.sin(0.2 * x**3))[:, None]


def _terms() -> Case:
    terms = ("p1*x", "p2*x^2", "p3*sin(0.2*x^3)", "p4*sin(2*x)*x")
    rivals = {
        f"M{count}": Rival(
            {"y": " + ".join(terms[:count])}, {f"p{k + 1}": (1.0, -10.0, 10.0) for k in range(count)}
        )
        for count in range(1, 5)
    }
    return Case(
        "vthr2014linear",
        "one to four terms",
        "J. Vanlier et al., BMC Syst. Biol. 8 (2014) 20",
        {"x": (-2.5, 2.5)},
        {"y": 0.5**0.5},
        rivals,
        "M3",
        _terms_truth,
        first=6,
    )


# --- ten products of powers with a factor


def _products_truth(settings: Floats) -> Floats:
    a, b, _ = settings.T
    return np.asarray(a**2 * b)[:, None]


def _products() -> Case:
    formulas = ("1", "a", "b", "c", "a*b", "a*c", "b*c", "a*b*c", "a^2*b", "a*b^2")
    return Case(
        "msm2010",
        "ten products of powers",
        "C. Michalik, M. Stuckert, W. Marquardt, Ind. Eng. Chem. Res. 49 (2010) 913",
        {"a": (0.0, 10.0), "b": (0.0, 10.0), "c": (0.0, 100.0)},
        {"y": 1.0},
        {
            f"M{k}": Rival({"y": f"p*{formula}"}, {"p": (10.0, 1e-3, 1e3)})
            for k, formula in enumerate(formulas, start=1)
        },
        "M9",
        _products_truth,
        first=2,
    )


CASES: Mapping[str, Callable[[], Case]] = {
    "vthr2014linear": _terms,
    "msm2010": _products,
    "bffeh1984": _two_rates,
    "mixing-M3": mixing,
    **{f"mixing-{name}": lambda name=name: mixing(name) for name in ("M1", "M2", "M4", "M5")},  # type: ignore[misc]
    "bff1983": _methanol,
}
