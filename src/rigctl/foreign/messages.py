"""Messages between rigctl and the processes that simulate: one line of JSON, then arrays of doubles.

The line gives the shapes of the arrays, whose bytes follow it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: bytes of a number
DOUBLE = 8


def write_message(stream: IO[bytes], content: Mapping[str, Any], *arrays: Floats) -> None:
    """Send a message."""
    head = {**content, "shapes": [list(one.shape) for one in arrays]}
    stream.write(json.dumps(head).encode() + b"\n")
    stream.writelines(np.ascontiguousarray(one, dtype=np.float64).tobytes() for one in arrays)
    stream.flush()


def read_message(stream: IO[bytes]) -> tuple[dict[str, Any], list[Floats]] | None:
    """The next message; None at the end."""
    line = stream.readline()
    if not line.endswith(b"\n"):
        return None
    content: dict[str, Any] = json.loads(line)
    arrays = []
    for shape in content.pop("shapes"):
        size = DOUBLE * math.prod(shape)
        data = stream.read(size)
        if len(data) < size:
            return None
        arrays.append(np.frombuffer(data, dtype=np.float64).reshape(shape))
    return content, arrays
