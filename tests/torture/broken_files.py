"""Files of ours, broken at random: each is read, or refused with one message; never a traceback."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time

from rigctl.errors import RigctlError

ROOT = Path(__file__).parents[2]
#: what a broken file is likely to hold: signs of YAML, units, numbers without end, controls, other scripts
_PIECES = (
    *(
        "{",
        "}",
        "[",
        "]",
        ":",
        "- ",
        "#",
        "'",
        '"',
        "|",
        ">",
        "&a",
        "*a",
        "!!python/object:os.system",
        "<<: *a",
    ),
    *("1e308", "-1e400", ".nan", ".inf", "0x7f", "1_000", "99999999999999999999", "bar", "degC", "m^2", "°C"),
    *("\x00", "\x1b[2J", "\r", "\t", "\ufeff", "\u202e", "\ud800"),
    *(
        "null",
        "true",
        "~",
        "on",
        "2026-01-01",
        "12:30:45",
        "position",
        "$oil",
        "__class__",
        "()" * 40,
        "((" * 60,
    ),
)


@dataclass(frozen=True)
class Kind:
    """A kind of file: its shipped examples and what reads one."""

    name: str
    examples: tuple[Path, ...]
    read: Callable[[Path], object]


def kinds() -> tuple[Kind, ...]:
    """Every kind of file that a user writes."""
    from rigctl.effects.user.load import load_effect
    from rigctl.model import load_model
    from rigctl.physics.user.load import load_family
    from rigctl.procedure import load_procedure
    from rigctl.rig import load_rig

    def found(folder: str) -> tuple[Path, ...]:
        return tuple(sorted((ROOT / folder).glob("*.yaml")))

    return (
        Kind("procedure", found("procedures"), load_procedure),
        Kind("rig", found("rigs"), load_rig),
        Kind("model", found("models"), load_model),
        Kind("effect", found("models/effects"), load_effect),
        Kind("family", found("models/families"), load_family),
    )


def broken(text: str, rng: random.Random) -> bytes:
    """A text with some of its pieces taken out, doubled, exchanged or replaced."""
    lines = text.splitlines(keepends=True)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(lines))
        line = lines[at]
        match rng.randrange(6):
            case 0:
                lines[at] = ""
            case 1:
                lines.insert(at, line)
            case 2:
                other = rng.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
            case 3:
                cut = rng.randrange(max(1, len(line)))
                lines[at] = line[:cut] + rng.choice(_PIECES) + line[cut + rng.randrange(3) :]
            case 4:
                lines[at] = " " * rng.randrange(6) + line
            case _:
                words = line.split(" ")
                words[rng.randrange(len(words))] = rng.choice(_PIECES)
                lines[at] = " ".join(words)
    content = "".join(lines).encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        content = content[: rng.randrange(max(1, len(content)))]
    if rng.random() < 0.05:
        content = rng.randbytes(rng.randrange(200))
    return content


@dataclass
class Found:
    """Numbers of files read and refused, and the longest processor time for one file, s."""

    read: int = 0
    refused: int = 0
    slowest: float = 0.0


def torture(folder: Path, trials: int, seed: int) -> Found:
    """Try broken files of each kind in turn; raises at the first that ends in anything but a message."""
    found, known = Found(), kinds()
    for trial in range(trials):
        rng = random.Random(f"{seed}-{trial}")
        kind = known[trial % len(known)]
        example = rng.choice(kind.examples)
        content = broken(example.read_text(encoding="utf-8"), rng)
        path = folder / example.name
        path.write_bytes(content)
        begin = process_time()
        try:
            kind.read(path)
        except RigctlError as refusal:
            assert str(refusal)
            found.refused += 1
        except Exception as problem:
            kept = folder / f"{kind.name}-{seed}-{trial}.yaml"
            kept.write_bytes(content)
            raise AssertionError(f"{kind.name} {trial} of seed {seed}: {problem!r}; see {kept}") from problem
        else:
            found.read += 1
        found.slowest = max(found.slowest, process_time() - begin)
    return found
