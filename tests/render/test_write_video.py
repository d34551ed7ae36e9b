"""Videos are whole or absent, however ffmpeg ends."""

from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from plnerf.errors import PlnerfError
from plnerf.render.write_video import write_video

W, H, COUNT = 80, 64, 12
FFMPEG = imageio_ffmpeg.get_ffmpeg_exe()
FAULTS = {
    "fails at once": "exit 1",
    "is killed": "head -c 40000 > /dev/null; kill -9 $$",
    "writes an empty file": 'cat > /dev/null; for last; do :; done; : > "$last"',
    # Encodes what comes in before the fault, and reads to the end: nobody has to notice.
    "stops half-way": f'case "$*" in *rawvideo*) (head -c {5 * W * H * 3}; cat > /dev/null);; esac | '
    f'{FFMPEG} "$@"',
}


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{i:02d}.png" for i in range(COUNT)]
    for i, path in enumerate(paths):
        Image.fromarray(np.full((H, W, 3), 20 * i, np.uint8)).save(path)
    return paths


@pytest.mark.parametrize("fault", FAULTS)
def test_no_video_is_left_where_ffmpeg_ends_early(
    fault: str, pictures: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "ffmpeg"
    script.write_text(f"#!/bin/sh\n{FAULTS[fault]}\n")
    script.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(script))
    monkeypatch.chdir(tmp_path)  # where the one that writes an empty file writes "-", its last argument, too
    count = 5 if fault == "stops half-way" else 0
    with pytest.raises(PlnerfError, match=rf"ffmpeg ended before .*: {count} of {COUNT} pictures are in it"):
        write_video(tmp_path / "out" / "path.mp4", pictures, 24.0)
    assert not list((tmp_path / "out").iterdir())


def test_names_that_ffmpeg_takes_for_something_else(
    pictures: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("-y.mp4", "http:x.mp4", "a b%d.mp4"):
        write_video(Path(name), pictures, 24.0)
        assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / name))[0] == COUNT
