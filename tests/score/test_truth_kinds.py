"""A truth.json whose values are of other kinds than they should be is refused, not guessed at."""

import json
from pathlib import Path
from typing import Any

import pytest

from plnerf.errors import SurveyError
from plnerf.pipeline import bundled_span
from plnerf.score.align import true_cameras
from plnerf.score.truth import read_truth

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "towers that are numbers": ({"towers": [1]}, "towers must be a list of objects"),
    "towers that are an object": ({"towers": {"a": 1}}, "towers must be a list of objects"),
    "plants that are a number": ({"vegetation": 3}, "vegetation must be a list of objects"),
    "houses that are a number": ({"houses": 3}, "houses must be a list of objects"),
    "a ground that is a list": ({"ground": [1]}, "ground must be an object"),
    "rows that are texts": ({"ground": {"rows": ["x"]}}, "rows must be a list of objects"),
    "a name that is a list": ({"name": ["x"]}, "its name must be a text, but is"),
    "a kind that is a list": ({"kind": ["phase"]}, "its kind must be one of"),
    "a place of texts": ({"a": ["0", "0", "9"]}, "expected 1 or more points of three finite numbers"),
    "a stretch of texts": ({"seen_m": [["0", "1"]]}, "seen_m must be a list of stretches"),
    "a stretch that is a text": ({"seen_m": "01"}, "seen_m must be a list of stretches"),
    "a stretch that is a number": ({"seen_m": 1}, "seen_m must be a list of stretches"),
    "a direction that is a text": ({"direction": "xy"}, "its direction must be two numbers"),
    "a diameter that is true": ({"diameter_m": True}, "expected a finite number, but found True"),
}


@pytest.mark.parametrize("name", WRONG)
def test_values_of_other_kinds_are_refused(name: str, tmp_path: Path) -> None:
    change, text = WRONG[name]
    data = json.loads((bundled_span() / "truth.json").read_text())
    ours = data if change.keys() & {"towers", "vegetation", "houses", "ground"} else data["conductors"][0]
    ours.update(change)
    (tmp_path / "truth.json").write_text(json.dumps(data))
    with pytest.raises(SurveyError, match=text):
        read_truth(tmp_path / "truth.json")


TEXTS = [{"name": "a", "T_world_camera": [["1"] * 4] * 4}]


@pytest.mark.parametrize("poses", [3, ["x"], [{"name": 3}], TEXTS])
def test_poses_of_other_kinds_are_refused(poses: Any, tmp_path: Path) -> None:
    (tmp_path / "truth.json").write_text(json.dumps({"poses": poses}))
    with pytest.raises(SurveyError, match="has poses that are none"):
        true_cameras(tmp_path / "truth.json")
