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
from numpy.typing import ArrayLike, NDArray


def frame(header: Mapping[str, Any], arrays: Sequence[tuple[str, ArrayLike]]) -> bytes:
    """A header and its arrays as one message."""
    given = [(name, np.ascontiguousarray(values, dtype="<f4")) for name, values in arrays]
    listed = [{"name": name, "shape": list(values.shape)} for name, values in given]
    text = json.dumps({**header, "arrays": listed}, allow_nan=False).encode("utf-8")
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *(values.tobytes() for _, values in given)])


def read_frame(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
    """Decode a message of `frame`; for tests and other clients.

    Raises
    ------
    ValueError
        the message is not a frame.
    """
    if len(message) < 4:
        raise ValueError("no frame")
    (length,) = struct.unpack_from("<I", message)
    header: dict[str, Any] = json.loads(message[4 : 4 + length])
    arrays, at = {}, 4 + length
    for one in header["arrays"]:
        count = int(np.prod(one["shape"], dtype=np.int64))
        values = np.frombuffer(message, "<f4", count, at)
        arrays[one["name"]], at = values.reshape(one["shape"]), at + 4 * count
    return header, arrays
