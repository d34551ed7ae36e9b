"""A run folder is enough to get the scene and the model back."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from tests.support.tiny_run import assert_same_bits, newest_tensors, tiny_config

from plnerf.errors import CheckpointError, ConfigError, SceneError
from plnerf.train.loop import train
from plnerf.train.report import SilentReport
from plnerf.train.run import build_model, open_run, open_scene, read_config, write_config


def test_config_comes_back_as_written(tmp_path: Path) -> None:
    config = tiny_config(Path("/data/span"), seconds=1 / 3, seed=1 << 40)
    write_config(tmp_path / "run", config)
    assert read_config(tmp_path / "run") == config
    write_config(tmp_path / "run", tiny_config(Path("/data/span")))
    assert read_config(tmp_path / "run") == tiny_config(Path("/data/span"))
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["config.json"]


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


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(ConfigError, match=r"is not a run folder: it has no config\.json") as caught:
            open_run(folder)
        assert str(folder) in str(caught.value)


SPOILT: dict[str, Callable[[Path], object]] = {
    "cannot be read": lambda path: path.write_text("{"),
    "can't decode": lambda path: path.write_bytes(b"\xff\xfe\x00"),
    "must be an object": lambda path: path.write_text("[]"),
    r"train\.learning_rate is an unknown key": lambda path: path.write_text(
        json.dumps(json.loads(path.read_text()) | {"train": {"learning_rate": 1}})
    ),
    "Is a directory": lambda path: (path.unlink(), path.mkdir()),
}


@pytest.mark.parametrize("pattern", SPOILT)
def test_a_spoilt_config(pattern: str, tmp_path: Path) -> None:
    write_config(tmp_path, tiny_config(Path("/data/span")))
    SPOILT[pattern](tmp_path / "config.json")
    with pytest.raises(ConfigError, match=pattern) as caught:
        read_config(tmp_path)
    assert str(tmp_path / "config.json") in str(caught.value)


def test_a_run_without_a_checkpoint(tmp_path: Path) -> None:
    write_config(tmp_path, tiny_config(Path("/data/span")))
    with pytest.raises(CheckpointError, match="holds no complete checkpoint yet") as caught:
        open_run(tmp_path)
    assert f"plnerf train /data/span -o {tmp_path} --resume" in str(caught.value)


def test_a_run_whose_scene_has_gone_or_grown(tiny_scene: Path, tmp_path: Path) -> None:
    run = train(tiny_config(tiny_scene, steps=1), tmp_path / "run", SilentReport())
    listing = tiny_scene / "transforms.json"
    data = json.loads(listing.read_text())
    listing.write_text(json.dumps(data | {"frames": data["frames"][:-1]}))
    with pytest.raises(
        CheckpointError, match=r"'appearance' has shape \(12, 16\), the model expects \(11, 16\)"
    ):
        open_run(run)
    tiny_scene.rename(tmp_path / "elsewhere")
    with pytest.raises(SceneError, match="is not there"):
        open_run(run)
