"""Arrays on their way to the browser: a header as JSON, then 32-bit floats.

    length of the header (uint32) | header, JSON filled up with spaces to whole words | arrays

everything little-endian. The header's ``arrays`` names each array with its shape, in the order in which they
follow; a missing value is NaN.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def frame(header: Mapping[str, Any], arrays: Sequence[tuple[str, ArrayLike]]) -> bytes:
    """A header and its arrays as one message."""
    given = [(name, np.ascontiguousarray(values, dtype="<f4")) for name, values in arrays]
    listed = [{"name": name, "shape": list(values.shape)} for name, values in given]
    text = json.dumps({**header, "arrays": listed}, allow_nan=False).encode("utf-8")
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *(values.tobytes() for _, values in given)])
