"""Logs of one motor, its voltage switched and its speed read, each headed as some logger heads its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

ROWS: Final = 160
STEP: Final = 0.05  # s


def _number(value: float) -> str:
    return f"{value:.3f}"


def _comma(value: float) -> str:
    return _number(value).replace(".", ",")


def _time_of_day(seconds: float) -> str:
    return f"10:00:{seconds:06.3f}"


def _date(seconds: float) -> str:
    return f"2026-03-14 10:00:{seconds:06.3f}"


def _us_date(seconds: float) -> str:
    return f"03/14/2026 10:00:{seconds:06.3f}"


@dataclass(frozen=True)
class Log:
    """How a logger writes the motor's log.

    Parameters
    ----------
    head: what is above the values, lines divided by newlines.
    time: how a row's time is written; None without one.
    number: how a reading is written.
    speed: from rad/s to what the heading says.
    more: cells between the time and the voltage, or after the speed.
    states: the units of voltage and speed that the file states; None where it states none.
    """

    head: str
    time: Callable[[float], str] | None = _number
    number: Callable[[float], str] = _number
    delimiter: str = ","
    speed: float = 1.0
    first: Callable[[int], Sequence[str]] = lambda _: ()
    last: Callable[[int], Sequence[str]] = lambda _: ()
    units: tuple[str | None, str | None] = (None, None)

    @property
    def readings(self) -> tuple[list[float], list[float]]:
        """Voltage and speed as the file has them."""
        speeds = [self.speed * _speed(row) for row in range(ROWS)]
        return [_voltage(row * STEP) for row in range(ROWS)], speeds

    @property
    def text(self) -> str:
        """The file."""
        lines = [self.head] if self.head else []
        for row in range(ROWS):
            seconds = row * STEP
            u, y = _voltage(seconds), _speed(row)
            cells = [
                *([] if self.time is None else [self.time(seconds)]),
                *self.first(row),
                self.number(u),
                self.number(self.speed * y),
                *self.last(row),
            ]
            lines.append(self.delimiter.join(cells))
        return "\n".join(lines) + "\n"


def _voltage(seconds: float) -> float:
    return 6.0 if 1.0 <= seconds < 4.0 else 3.0 if seconds >= 4.0 else 0.0


def _speed(row: int) -> float:
    """A first-order lag of the voltage, and some noise that is the same each time."""
    value = 0.0
    for past in range(row):
        value += (1.0 - math.exp(-STEP / 0.4)) * (15.0 * _voltage(past * STEP) - value)
    return value + 0.05 * math.sin(12.9898 * row * row)


RPM: Final = 60.0 / (2.0 * math.pi)
MILLIS: Final = 1000.0


def _millis(seconds: float) -> str:
    return f"{seconds * MILLIS:.0f}"


def _sample_number(row: int) -> tuple[str, ...]:
    return (str(row + 1),)


LOGS: Final[dict[str, Log]] = {
    "brackets": Log("time [s],voltage [V],speed [rad/s]", units=("V", "rad/s")),
    "parentheses": Log("Time (s),Voltage (V),Speed (rpm)", speed=RPM, units=("V", "rpm")),
    "endings": Log("t_ms,u_V,n_rpm", time=_millis, speed=RPM, units=("V", "rpm")),
    "plain names": Log("time,voltage,speed"),
    "letters": Log("t,u,w"),
    "capitals": Log("TIME,VOLTAGE,SPEED"),
    "arduino": Log("millis,pwm,rpm", time=_millis, speed=RPM, units=(None, "rpm")),
    "arduino micros": Log("micros,U,omega", time=lambda s: f"{s * 1e6:.0f}"),
    "numpy savetxt": Log("# time voltage speed", delimiter=" "),
    "commented commas": Log("# time,voltage,speed"),
    "commented units": Log("#time [s],voltage [V],speed [rad/s]", units=("V", "rad/s")),
    "commented notes": Log("# motor test 7\n# operator: A\n# t/s, U/V, n/rpm", speed=RPM, units=("V", "rpm")),
    "gnuplot": Log("#t\tU\tn", delimiter="\t"),
    "matlab percent": Log("% time voltage speed", delimiter=" "),
    "labview": Log("X_Value\tVoltage\tSpeed", delimiter="\t"),
    "labview comma": Log("X_Value;Spannung;Drehzahl", number=_comma, time=_comma, delimiter=";"),
    "labview untitled": Log("X_Value\tUntitled\tUntitled 1\tComment", delimiter="\t", last=lambda _: ("",)),
    "sample number": Log("Sample,Voltage,Speed", time=None, first=_sample_number),
    "sample and time": Log(
        "Sample,Time (s),CH1 (V),CH2 (V)",
        time=None,
        first=lambda k: (str(k), _number(k * STEP)),
        units=("V", "V"),
        speed=0.1,
    ),
    "index of pandas": Log(",time,voltage,speed", time=None, first=lambda k: (str(k), _number(k * STEP))),
    "scan": Log(
        "Scan,Time,101 <V>,102 <V>",
        time=None,
        first=lambda k: (str(k + 1), _number(k * STEP)),
        speed=0.1,
        units=("V", "V"),
    ),
    "oscilloscope": Log("Time,Channel A,Channel B\n(s),(V),(V)\n", speed=0.1, units=("V", "V")),
    "oscilloscope second": Log("x-axis,1,2\nsecond,Volt,Volt", speed=0.1, units=("V", "V")),
    "unit row": Log("Time;Voltage;Speed\ns;V;1/min", delimiter=";", speed=RPM, units=("V", "1/min")),
    "german": Log(
        "Zeit [s];Spannung [V];Drehzahl [1/min]",
        number=_comma,
        time=_comma,
        delimiter=";",
        speed=RPM,
        units=("V", "rpm"),
    ),
    "german plain": Log("Zeit;Spannung;Drehzahl", number=_comma, time=_comma, delimiter=";"),
    "german in": Log(
        "Zeit in s;Spannung in V;Drehzahl in U/min",
        number=_comma,
        time=_comma,
        delimiter=";",
        speed=RPM,
        units=("V", "rpm"),
    ),
    "german clock": Log(
        "Uhrzeit;Spannung;Drehzahl",
        number=_comma,
        time=lambda s: _time_of_day(s).replace(".", ","),
        delimiter=";",
    ),
    "german date": Log(
        "Datum;Zeit;Spannung [V];Drehzahl [U/min]",
        number=_comma,
        time=None,
        delimiter=";",
        speed=RPM,
        first=lambda k: ("14.03.2026", _time_of_day(k * STEP)),
        units=("V", "rpm"),
    ),
    "spanish": Log(
        "Tiempo (s);Tensión (V);Velocidad (rpm)",
        number=_comma,
        time=_comma,
        delimiter=";",
        speed=RPM,
        units=("V", "rpm"),
    ),
    "spanish plain": Log("tiempo,tension,velocidad"),
    "french": Log(
        "Temps (s);Tension (V);Vitesse (tr/min)",
        number=_comma,
        time=_comma,
        delimiter=";",
        speed=RPM,
        units=("V", "rpm"),
    ),
    "french plain": Log("Temps;Tension;Vitesse", number=_comma, time=_comma, delimiter=";"),
    "italian": Log(
        "Tempo [s];Tensione [V];Velocità [giri/min]",
        number=_comma,
        time=_comma,
        delimiter=";",
        speed=RPM,
        units=("V", "rpm"),
    ),
    "timestamp": Log("timestamp,voltage,speed", time=_date),
    "iso": Log(
        "datetime,voltage_V,speed_rpm",
        time=lambda s: _date(s).replace(" ", "T") + "Z",
        speed=RPM,
        units=("V", "rpm"),
    ),
    "epoch": Log("Timestamp,Voltage,Speed", time=lambda s: f"{1773482400.0 + s:.3f}"),
    "excel us": Log("Date/Time,Voltage (V),Speed (RPM)", time=_us_date, speed=RPM, units=("V", "rpm")),
    "elapsed": Log("Elapsed Time,Set Voltage,Actual Speed"),
    "unknown units": Log("time [s],drive [ticks],speed [counts]", units=("count", "counts")),
    "greek": Log("t [s],U_a [V],ω [rad/s]", units=("V", "rad/s")),
    "no heading": Log(""),
    "quoted": Log('"Time","Voltage","Speed"'),
    "spaces": Log("Time      Voltage   Speed", delimiter="   "),
}
