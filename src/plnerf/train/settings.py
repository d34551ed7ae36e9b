"""Frozen dataclasses of settings to JSON; `from_json` brings them back, strictly."""

import dataclasses
import json
from typing import Any

from plnerf.scene.typed_json import from_json as from_json


def to_json(settings: Any) -> dict[str, Any]:
    """A dataclass as plain JSON values (tuples become lists, paths texts)."""
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(settings), default=str))
    return plain
