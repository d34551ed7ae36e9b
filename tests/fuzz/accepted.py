"""What a reader does with bytes: it refuses them with an error of plnerf's, or gives finite content."""

import dataclasses
import time
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from tests.fuzz.readers import Reader
from torch import Tensor

from plnerf.errors import PlnerfError

MAX_CPU_S, MAX_MEMORY = 2.0, 1 << 30
"""Of an input."""
AS_IN_THE_FILE = "attributes"
"""Of a cloud: columns that are written back as they were read, and used for nothing."""


class Broken(AssertionError):
    """An input on which a reader does neither."""


def feed(reader: Reader, content: bytes) -> bool:
    """Whether the reader takes a file of this content.  Raises Broken, and what is no PlnerfError."""
    reader.path.write_bytes(content)
    start = time.thread_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = reader.read()
    except PlnerfError as error:
        if not 10 < len(str(error)) < 5000:
            raise Broken(f"an error of {len(str(error))} characters: {str(error)[:300]}") from error
        return False
    finally:
        if (took := time.thread_time() - start) > MAX_CPU_S:
            raise Broken(f"{took:.1f} s for {len(content)} bytes")
    if problem := not_finite(found):
        raise Broken(f"accepted, but {problem}")
    return True


def not_finite(value: Any, key: str = "it") -> str | None:
    """What in a value is not finite, by its path; None where all is."""
    if isinstance(value, float):
        return None if np.isfinite(value) else f"{key} is {value}"
    if isinstance(value, Tensor):
        value = value.numpy()
    if isinstance(value, np.ndarray):
        bad = value.dtype.kind == "f" and not np.isfinite(value).all()
        return f"{key} holds a number that is not finite" if bad else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts: Iterable[tuple[Any, Any]] = (
            (one.name, getattr(value, one.name)) for one in dataclasses.fields(value)
        )
    elif isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, list | tuple):
        parts = enumerate(value)
    else:
        return None
    return next(
        (
            found
            for name, part in parts
            if name != AS_IN_THE_FILE and (found := not_finite(part, f"{key}.{name}"))
        ),
        None,
    )
