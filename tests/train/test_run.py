"""A run folder is enough to get the scene and the model back."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.tiny_run import assert_same_bits, newest_tensors, open_tiny, tiny_config

from plnerf.errors import CheckpointError, ConfigError, SceneError
from plnerf.scene import memory
from plnerf.scene.scene import Scene
from plnerf.train.loop import train
from plnerf.train.report import SilentReport
from plnerf.train.run import build_model, open_run, open_scene, read_config, write_run
from plnerf.train.scene_record import SceneRecord, read_record


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return open_tiny(tiny_scene, tmp_path)


def test_config_comes_back_as_written(scene: Scene, tmp_path: Path) -> None:
    config = tiny_config(Path("/data/span"), seconds=1 / 3, seed=1 << 40)
    write_run(tmp_path / "run", config, scene)
    assert read_config(tmp_path / "run") == config
    write_run(tmp_path / "run", tiny_config(Path("/data/span")), scene)
    assert read_config(tmp_path / "run") == tiny_config(Path("/data/span"))
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"config.json", "scene.json"}


def test_the_scenes_record_comes_back_to_the_last_bit(scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path / "run", tiny_config(Path("/data/span")), scene)
    kept, made = read_record(tmp_path / "run"), SceneRecord.of(scene)
    assert (kept.names, kept.train, kept.test) == (made.names, made.train, made.test)
    assert kept.frames.to_json() == made.frames.to_json() and np.array_equal(kept.box, made.box)
    for one in dataclasses.fields(made.cameras):
        ours, theirs = getattr(kept.cameras, one.name), getattr(made.cameras, one.name)
        assert ours.dtype == theirs.dtype and torch.equal(ours, theirs), one.name


@pytest.mark.parametrize("text", ["{", "[]", '{"format_version": 1}', '{"format_version": 9}'])
def test_a_spoilt_record(text: str, scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path, tiny_config(Path("/data/span")), scene)
    (tmp_path / "scene.json").write_text(text)
    with pytest.raises(ConfigError, match=r"scene\.json .*train again"):
        read_record(tmp_path)


def test_a_record_of_a_place_that_32_bits_do_not_hold(scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path, tiny_config(Path("/data/span")), scene)
    data = json.loads((tmp_path / "scene.json").read_text())
    data["cameras"]["centre"][0][0] = 1e300
    (tmp_path / "scene.json").write_text(json.dumps(data))
    with pytest.raises(ConfigError, match=r"scene\.json .*centre holds a number that is too large"):
        read_record(tmp_path)


@pytest.mark.parametrize("wrong", [[[0.0, 0.0]], [["a", 0, 0]], 3, {"a": 1}])
def test_a_record_of_stated_centres_that_are_none(wrong: object, scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path, tiny_config(Path("/data/span")), scene)
    data = json.loads((tmp_path / "scene.json").read_text())
    (tmp_path / "scene.json").write_text(json.dumps(data | {"stated_centre": wrong}))
    with pytest.raises(ConfigError, match=r"scene\.json .*train again"):
        read_record(tmp_path)


def test_a_run_of_an_earlier_version_is_to_be_trained_again(scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path, tiny_config(Path("/data/span")), scene)
    data = json.loads((tmp_path / "config.json").read_text())
    del data["format_version"]
    (tmp_path / "config.json").write_text(json.dumps(data))
    with pytest.raises(ConfigError, match=r"has format version 1, .* reads version 2\. Train again"):
        open_run(tmp_path)


def test_a_trained_run_opens_with_its_weights(tiny_scene: Path, tmp_path: Path) -> None:
    config = tiny_config(tiny_scene, steps=5, seed=3)
    run = open_run(train(config, tmp_path / "run", SilentReport()))
    assert (run.config, run.step, run.folder) == (config, 5, tmp_path / "run")
    assert run.scene.names == open_scene(config, tmp_path / "run").names
    assert not run.model.training
    saved = newest_tensors(tmp_path / "run")
    weights = {f"model.{name}": value for name, value in run.model.state_dict().items()}
    assert_same_bits(weights, {name: value for name, value in saved.items() if name.startswith("model.")})


def test_untrained_weights_are_a_function_of_the_seed(tiny_scene: Path, tmp_path: Path) -> None:
    scene = open_scene(tiny_config(tiny_scene), tmp_path)
    first, again, other = (build_model(tiny_config(tiny_scene, seed=seed), scene) for seed in (1, 1, 2))
    assert_same_bits(first.state_dict(), again.state_dict())
    assert not torch.equal(first.field.grid.table, other.field.grid.table)
    assert not torch.equal(first.proposals[0].network[0].weight, other.proposals[0].network[0].weight)


@pytest.mark.skipif(torch.cuda.is_available(), reason="only without a CUDA device")
def test_a_run_for_a_device_that_is_not_there(tiny_scene: Path, tmp_path: Path) -> None:
    config = tiny_config(tiny_scene, "device=cuda", "backend=torch")
    with pytest.raises(ConfigError, match="sees no CUDA device"):
        build_model(config, open_scene(config, tmp_path))


def test_a_model_that_does_not_fit_into_memory_is_not_built(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    config = tiny_config(tiny_scene, "model.field.grid.log2_table=30", "model.field.grid.finest=100000")
    with pytest.raises(ConfigError, match=r"This model needs at least .* of memory, but 8\.0 GB are free"):
        build_model(config, open_scene(config, tmp_path))


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(ConfigError, match=r"is not a run folder: it has no config\.json") as caught:
            open_run(folder)
        assert str(folder) in str(caught.value)


SPOILT: dict[str, Callable[[Path], object]] = {
    "is not valid JSON": lambda path: path.write_text("{"),
    "can't decode": lambda path: path.write_bytes(b"\xff\xfe\x00"),
    "must be an object": lambda path: path.write_text("[]"),
    r"train\.learning_rate is an unknown key": lambda path: path.write_text(
        json.dumps(json.loads(path.read_text()) | {"train": {"learning_rate": 1}})
    ),
    "Is a directory": lambda path: (path.unlink(), path.mkdir()),
}


@pytest.mark.parametrize("pattern", SPOILT)
def test_a_spoilt_config(pattern: str, scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path, tiny_config(Path("/data/span")), scene)
    SPOILT[pattern](tmp_path / "config.json")
    with pytest.raises(ConfigError, match=pattern) as caught:
        read_config(tmp_path)
    assert str(tmp_path / "config.json") in str(caught.value)


def test_a_run_without_a_checkpoint(scene: Scene, tmp_path: Path) -> None:
    write_run(tmp_path, tiny_config(Path("/data/span")), scene)
    with pytest.raises(CheckpointError, match="holds no complete checkpoint yet") as caught:
        open_run(tmp_path)
    assert f"plnerf train /data/span -o {tmp_path} --resume" in str(caught.value)


def test_a_run_whose_scene_has_gone_or_changed(tiny_scene: Path, tmp_path: Path) -> None:
    """It opens and has cameras; only its photos are asked for in vain."""
    run = train(tiny_config(tiny_scene, steps=1), tmp_path / "run", SilentReport())
    listing = tiny_scene / "transforms.json"
    data = json.loads(listing.read_text())
    listing.write_text(json.dumps(data | {"frames": data["frames"][:-1]}))
    with pytest.raises(SceneError, match="has changed since the run"):
        _ = open_run(run).scene
    data["frames"][0]["transform_matrix"][0][3] += 0.01
    listing.write_text(json.dumps(data))
    with pytest.raises(SceneError, match="has changed since the run"):
        _ = open_run(run).scene
    tiny_scene.rename(tmp_path / "elsewhere")
    opened = open_run(run)
    assert len(opened.field.cameras) == len(opened.record.names) == 12
    with pytest.raises(SceneError, match="is not there"):
        _ = opened.scene
