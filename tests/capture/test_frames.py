"""Out of a video that hovers, blurs and jumps, what moves on is kept, and the rest has its reason."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from plnerf.capture.frames import LEAST, MOST, Taken, choose_frames
from plnerf.capture.motion import look_at, motion_between
from plnerf.capture.video import stated_count, video_pictures, write_pictures
from plnerf.errors import CaptureError

W, H = 320, 200


def ground(seed: int = 0) -> np.ndarray:
    """A wide texture with corners of all sizes, RGB."""
    random = np.random.default_rng(seed)
    picture = np.zeros((H + 120, 6 * W, 3), np.float32)
    for size in (4, 9, 25):
        small = random.random((picture.shape[0] // size + 2, picture.shape[1] // size + 2, 3), np.float32)
        large = cv2.resize(small, None, fx=size, fy=size, interpolation=cv2.INTER_NEAREST)
        picture += large[: picture.shape[0], : picture.shape[1]] / 3
    return np.round(255 * picture).astype(np.uint8)


GROUND = ground()


def seen(x: float, y: float = 40.0, blur: int = 0) -> np.ndarray:
    picture = cv2.getRectSubPix(GROUND, (W, H), (x + W / 2, y + H / 2))
    return cv2.blur(picture, (blur, 1)) if blur else picture


def chosen(pictures: list[np.ndarray]) -> list[Taken]:
    return choose_frames((f"{i:03d}", i / 30, picture) for i, picture in enumerate(pictures))


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (32, 0), (64, 20), (160, 0)])
def test_the_overlap_is_that_of_the_shift(dx: int, dy: int) -> None:
    motion = motion_between(look_at(seen(100)), look_at(seen(100 + dx, 40 + dy)))
    assert motion is not None
    assert motion.overlap == pytest.approx((1 - dx / W) * (1 - dy / H), abs=0.02)


def test_flying_nearer_keeps_what_is_in_the_middle() -> None:
    """Zoomed by two, the second picture shows a quarter of the first."""
    far = seen(200)
    near = cv2.resize(far[H // 4 : 3 * H // 4, W // 4 : 3 * W // 4], (W, H))
    motion = motion_between(look_at(far), look_at(near))
    assert motion is not None and motion.overlap == pytest.approx(0.25, abs=0.03)


def test_other_places_and_empty_pictures_have_no_motion() -> None:
    here = look_at(seen(0))
    assert motion_between(here, look_at(np.full((H, W, 3), 128, np.uint8))) is None
    other = motion_between(here, look_at(ground(9)[:H, :W]))
    assert other is None or other.matches < 30


@pytest.mark.slow
def test_a_steady_flight_is_thinned_to_the_asked_overlap() -> None:
    found = chosen([seen(4.0 * i) for i in range(150)])
    kept = [int(taken.name) for taken in found if taken.kept]
    steps = np.diff(kept) * 4.0 / W
    assert kept[0] == 0 and not any(taken.gap for taken in found)
    assert (steps <= 1 - LEAST + 0.02).all() and (steps >= 1 - MOST - 0.02).all()
    assert np.median(steps) > 0.17  # as few as the overlap allows
    assert {taken.reason for taken in found if not taken.kept} <= {
        "near-duplicate",
        "another beside it was kept",
    }
    for taken in found:
        if taken.kept and taken.overlap is not None:
            assert LEAST - 0.02 <= taken.overlap <= MOST + 0.02


def test_hovering_gives_one_picture() -> None:
    found = chosen([seen(50 + 0.3 * (i % 3)) for i in range(30)])
    assert [taken.kept for taken in found] == [True] + [False] * 29
    assert {taken.reason for taken in found[1:]} == {"near-duplicate"}


def test_blurred_pictures_are_left_out() -> None:
    pictures = [seen(8.0 * i, blur=15 if i % 4 == 1 else 0) for i in range(60)]
    found = chosen(pictures)
    for i, taken in enumerate(found):
        assert (taken.reason == "blurred") == (i % 4 == 1), taken
    assert sum(taken.kept for taken in found) > 5


def test_a_jump_is_kept_and_called_a_gap() -> None:
    found = chosen([seen(4.0 * i) for i in range(40)] + [seen(1000 + 4.0 * i) for i in range(40)])
    gaps = [i for i, taken in enumerate(found) if taken.gap]
    assert gaps == [40] and found[40].kept
    assert sum(taken.kept for taken in found[40:]) > 2


def test_all_of_one_blur_is_not_called_blurred() -> None:
    """A soft lens is soft everywhere: blur is told from neighbours."""
    found = chosen([seen(16.0 * i, blur=5) for i in range(20)])
    assert not any(taken.reason == "blurred" for taken in found)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "flight.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, (W, H))
    for i in range(40):
        writer.write(cv2.cvtColor(seen(6.0 * i), cv2.COLOR_RGB2BGR))
    writer.release()
    return path


def test_a_video_is_read_with_its_times_and_chosen_pictures_are_written(video: Path, tmp_path: Path) -> None:
    pictures = list(video_pictures(video))
    assert [name for name, _, _ in pictures] == [f"{i:06d}" for i in range(40)] and stated_count(video) == 40
    assert [time for _, time, _ in pictures] == pytest.approx(np.arange(40) / 25, abs=0.021)
    assert np.abs(pictures[10][2].astype(float) - seen(60)).mean() < 12  # RGB, as it was written
    kept = [taken.name for taken in choose_frames(video_pictures(video)) if taken.kept]
    assert 3 <= len(kept) <= 12
    written = write_pictures(video, kept, tmp_path / "images")
    assert [path.stem for path in written] == kept == sorted(p.stem for p in (tmp_path / "images").iterdir())
    again = cv2.cvtColor(cv2.imread(str(written[1])), cv2.COLOR_BGR2RGB)
    assert np.abs(again.astype(float) - pictures[int(kept[1])][2]).mean() < 8  # chroma is halved


def test_what_is_no_video_is_told(video: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("not a video")
    for path in (tmp_path / "text.mp4", tmp_path / "absent.mp4"):
        with pytest.raises(CaptureError, match="cannot be opened as a video"):
            list(video_pictures(path))
    data = video.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(CaptureError):
        list(video_pictures(tmp_path / "cut.mp4"))
