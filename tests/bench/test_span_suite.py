"""The suite `span`: every preset on every scene of known wires, none twice; no scene without a truth."""

import json
import shutil
from pathlib import Path

import pytest
from rich.console import Console
from tests.support.changed import changed
from tests.support.tiny_run import SMALL

from plnerf.bench import span_suite
from plnerf.bench.config import SPAN_PRESETS, BenchConfig
from plnerf.errors import ConfigError
from plnerf.pipeline import bundled_span
from plnerf.presets import preset_names
from plnerf.presets._find import find_preset
from plnerf.train.config import Settings

SYSTEMS = {
    name: changed(Settings(find_preset(name).model, find_preset(name).train), SMALL) for name in SPAN_PRESETS
}


def give_truth(scene: Path) -> Path:
    line = [[x, 0.3, 1.2] for x in range(-10, 11)]
    wire = {"name": "one", "kind": "phase", "a": line[0], "b": line[-1], "polyline": line, "diameter_m": 0.03}
    content = {"conductors": [wire], "towers": [{"foot": [-10, 0.3, 0], "height_m": 2.0}]}
    (scene / "truth.json").write_text(json.dumps(content))
    return scene


def bench_of(out: Path, scene: Path | None) -> BenchConfig:
    return BenchConfig(out, suites=("span",), scene=scene, systems=SYSTEMS, seconds=0.3, quick=True)


@pytest.mark.slow
def test_every_preset_has_a_row_and_is_not_run_again(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained: list[str] = []

    def short(scene: Path, out: Path, **options: object) -> Path:
        trained.append(str(options["preset"]))
        return train_scene(scene, out, **{**options, "seconds": None, "steps": 2})  # type: ignore[arg-type]

    train_scene = span_suite.train_scene
    monkeypatch.setattr(span_suite, "train_scene", short)
    bench = bench_of(tmp_path / "bench", give_truth(tiny_scene))
    results = span_suite.measure_spans(bench, Console(quiet=True))
    presets = list(SPAN_PRESETS)
    assert trained == presets == [one["preset"] for one in results] and set(presets) <= set(preset_names())
    for one in results:
        assert (one["scene"], one["steps"], one["views"]) == ("tiny", 2, 1)
        assert {"recall_5cm", "recall_10cm", "recall_25cm", "precision_10cm"} <= one["score"][
            "overall"
        ].keys()
        folder = tmp_path / "bench" / "span" / "tiny" / one["preset"]
        assert (folder / span_suite.RESULT).exists() and (folder / "config.json").exists()
    again = span_suite.measure_spans(bench, Console(quiet=True))
    assert again == results and trained == presets
    table = span_suite.span_table(results, 0.3)
    assert [row[:2] for row in table.rows] == [("tiny", preset) for preset in presets]
    assert all(len(row) == len(table.columns) for row in table.rows)

    for one in results:  # a scene of which nothing is scored has a row too
        one["score"]["wires"] = []
    assert len(span_suite.span_table(results, 0.3).rows) == len(presets)

    # What was cut off between training and scoring is scored, not trained again.
    (tmp_path / "bench/span/tiny" / presets[1] / span_suite.RESULT).unlink()
    third = span_suite.measure_spans(bench, Console(quiet=True))
    assert trained == presets
    assert [one["score"] for one in third] == [one["score"] for one in again]


def test_a_folder_of_scenes_is_taken_in_order_and_one_scene_alone(tiny_scene: Path, tmp_path: Path) -> None:
    give_truth(tiny_scene)
    for name in ("b", "a", "c"):
        shutil.copytree(tiny_scene, tmp_path / "all" / name)
    (tmp_path / "all" / "notes").mkdir()
    bench = bench_of(tmp_path / "out", tmp_path / "all")
    assert [scene.name for scene in span_suite.scenes_of(bench)] == ["a", "b", "c"]
    assert span_suite.scenes_of(bench_of(tmp_path / "out", tiny_scene)) == [tiny_scene]
    assert span_suite.scenes_of(bench_of(tmp_path / "out", None)) == [bundled_span()]


def test_scenes_without_a_truth_are_named(tiny_scene: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"truth\.json.*" + str(tiny_scene)):
        span_suite.scenes_of(bench_of(tmp_path / "out", tiny_scene))
    shutil.copytree(tiny_scene, tmp_path / "all" / "without")
    shutil.copytree(give_truth(tiny_scene), tmp_path / "all" / "with")
    with pytest.raises(ConfigError) as caught:
        span_suite.scenes_of(bench_of(tmp_path / "out", tmp_path / "all"))
    assert str(tmp_path / "all" / "without") in str(caught.value)
    assert str(tmp_path / "all" / "with") + "," not in str(caught.value)
    for place in (tmp_path / "nowhere", tmp_path / "out"):
        with pytest.raises(ConfigError, match="no scene folder"):
            span_suite.scenes_of(bench_of(tmp_path / "out", place))
