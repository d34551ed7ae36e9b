r"""Wire maps against wires drawn by hand: precision and recall of pixels, for several filters.

    python benchmarks/wire_maps.py DATA -o OUT

DATA holds images/, wire/ and, optionally, mast/: photos and masks (black = wire or mast) of the same names;
the photos are reduced to the masks' size.  Or DATA is a scene folder with wire masks (transforms.json).
Writes wire_maps.md, wire_maps.json and pictures of the best and worst five.  Needs scikit-image.

A pixel that a map shows is right if it lies within the tolerance of a mask's pixel; a pixel on a mask's
centre line is found if one that the map shows lies within the tolerance of it.  Pixels of all images are
pooled.  Every other photo serves for choosing settings and thresholds, near duplicates on the same side.
"""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import tyro
from skimage.filters import frangi, sato
from skimage.morphology import skeletonize

from plnerf.bench.machine import circumstances
from plnerf.bench.tables import Table, figure
from plnerf.detect.ridges import ridge_map
from plnerf.errors import SceneError
from plnerf.train.pixels import ridge_strength

SCALES_PX = (1, 2, 3)
SAME_PHOTO = 0.9
"""Correlation of thumbnails from which two photos count as one."""
TOP_PART = 0.1


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo with its true wires."""

    name: str
    image: np.ndarray  # uint8 h w 3
    wire: np.ndarray  # bool h w
    mast: np.ndarray  # bool h w


@dataclass(frozen=True, eq=False)
class Judged:
    """One map: its values, which of them lie at a wire, and the best value at each pixel of centre lines."""

    values: np.ndarray
    right: np.ndarray
    centre: np.ndarray


@dataclass(frozen=True)
class Score:
    """Over the pixels of all photos."""

    average_precision: float
    threshold: float
    f1: float
    precision: float
    recall: float
    top_precision: float
    """Of the `TOP_PART` of each photo's pixels with the largest values."""
    top_recall: float


def hessian(image: np.ndarray) -> np.ndarray:
    """Today's detail map: the largest curvature at 1 and 2 px."""
    return ridge_strength(image)


def curvature(image: np.ndarray) -> np.ndarray:
    """The plain Hessian at one scale: the larger eigenvalue's size at 1.5 px."""
    grey = cv2.GaussianBlur(image.astype(np.float32).mean(-1) / 255, (0, 0), 1.5)
    yy, xy = np.gradient(np.gradient(grey, axis=0))
    xx = np.gradient(np.gradient(grey, axis=1), axis=1)
    return np.abs(xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)


def either(filter_: Callable[..., np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """A filter of scikit-image for bright and for dark ridges."""

    def both(image: np.ndarray) -> np.ndarray:
        grey = image.astype(np.float32).mean(-1) / 255
        return np.maximum(*(filter_(grey, sigmas=SCALES_PX, black_ridges=black) for black in (False, True)))

    return both


MAPS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "Hessian, 1.5 px": curvature,
    "Hessian, 1 and 2 px (hessian)": hessian,
    "Sato": either(sato),
    "Frangi": either(frangi),
    "lines (ridge)": ridge_map,
}
OURS = "lines (ridge)"


def disc(radius_px: float) -> np.ndarray:
    reach = int(radius_px)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return (x**2 + y**2 <= radius_px**2).astype(np.uint8)


def judge(strength: np.ndarray, photo: Photo, tolerance_px: float, masts: bool) -> Judged:
    """What a map says of one photo; without masts, their surroundings are left out."""
    near = cv2.dilate(photo.wire.astype(np.uint8), disc(tolerance_px)) > 0
    use = np.ones_like(near) if masts else cv2.dilate(photo.mast.astype(np.uint8), disc(tolerance_px)) == 0
    best = cv2.dilate(strength.astype(np.float32), disc(tolerance_px))
    return Judged(strength[use].astype(np.float32), near[use], best[skeletonize(photo.wire) & use])


def precision_recall(judged: Sequence[Judged], thresholds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pooled precision and recall of the pixels with values of at least each threshold."""
    values = np.concatenate([one.values for one in judged])
    order = np.argsort(-values)
    shown = np.searchsorted(-values[order], -thresholds, side="right")
    right = np.concatenate([[0], np.cumsum(np.concatenate([one.right for one in judged])[order])])[shown]
    precision = np.where(shown > 0, right / np.maximum(shown, 1), 1.0)
    centre = np.sort(np.concatenate([one.centre for one in judged]))
    return precision, 1 - np.searchsorted(centre, thresholds) / max(len(centre), 1)


def f1_of(precision: np.ndarray, recall: np.ndarray) -> np.ndarray:
    return 2 * precision * recall / np.maximum(precision + recall, 1e-9)


def score(judged: Sequence[Judged], threshold: float | None = None) -> Score:
    """At the threshold of the best F1, or at the given one."""
    values = np.concatenate([one.values for one in judged])
    levels = np.unique(np.quantile(values, 1 - np.geomspace(1e-5, 1, 400)))
    precision, recall = precision_recall(judged, levels)
    ordered = np.argsort(recall, kind="stable")
    recalls, precisions = recall[ordered], precision[ordered]
    average = float(np.trapezoid(precisions, recalls) + recalls[0] * precisions[0])
    if threshold is None:
        threshold = float(levels[f1_of(precision, recall).argmax()])
    p, r = precision_recall(judged, np.array([threshold]))
    tops = [np.quantile(one.values, 1 - TOP_PART) for one in judged]
    shown = [(one.values >= top, one.centre >= top) for one, top in zip(judged, tops, strict=True)]
    right = sum(float((mask & one.right).sum()) for one, (mask, _) in zip(judged, shown, strict=True))
    top_precision = right / sum(int(mask.sum()) for mask, _ in shown)
    top_recall = float(np.concatenate([centre for _, centre in shown]).mean())
    at = (float(f1_of(p, r)[0]), float(p[0]), float(r[0]))
    return Score(average, threshold, *at, top_precision, top_recall)


def read_photos(data: Path) -> list[Photo]:
    """Photos of a folder with hand-drawn masks, or the images of a scene with its wire masks."""
    return list(read_scene(data) if (data / "transforms.json").is_file() else read_drawn(data))


def read_drawn(data: Path) -> Iterator[Photo]:
    names = sorted(path.name for path in (data / "images").glob("*"))
    if not names or not (data / "wire").is_dir():
        raise SceneError(
            f"{data} must hold the folders images/ and wire/ (and may hold mast/) with pictures of the same "
            "names, or a transforms.json with wire masks. Give the folder of such data."
        )
    for name in names:
        wire = picture(data / "wire" / name, cv2.IMREAD_GRAYSCALE) < 128
        size = (wire.shape[1], wire.shape[0])
        full = picture(data / "images" / name, cv2.IMREAD_COLOR)[..., ::-1]
        mast = data / "mast" / name
        yield Photo(
            name,
            cv2.resize(full, size, interpolation=cv2.INTER_AREA),
            wire,
            picture(mast, cv2.IMREAD_GRAYSCALE) < 128 if mast.is_file() else np.zeros_like(wire),
        )


def read_scene(data: Path) -> Iterator[Photo]:
    for frame in json.loads((data / "transforms.json").read_text())["frames"]:
        wire = picture(data / frame["wire_mask_path"], cv2.IMREAD_GRAYSCALE) >= 128
        image = np.ascontiguousarray(picture(data / frame["file_path"], cv2.IMREAD_COLOR)[..., ::-1])
        yield Photo(Path(frame["file_path"]).name, image, wire, np.zeros_like(wire))


def picture(path: Path, mode: int) -> np.ndarray:
    array = cv2.imread(str(path), mode)
    if array is None:
        raise SceneError(f"The picture {path} is missing or cannot be read. Put it there.")
    return array


def halves(photos: Sequence[Photo]) -> tuple[list[Photo], list[Photo]]:
    """Those for choosing settings and those held out: in turn, photos of one view on the same side."""
    thumbs = np.stack([cv2.resize(p.image, (24, 36), interpolation=cv2.INTER_AREA).ravel() for p in photos])
    thumbs = thumbs - thumbs.mean(1, keepdims=True)
    thumbs /= np.linalg.norm(thumbs, axis=1, keepdims=True)
    groups: list[list[int]] = []
    for i, thumb in enumerate(thumbs):
        same = [group for group in groups if thumb @ thumbs[group[0]] > SAME_PHOTO]
        if same:
            same[0].append(i)
        else:
            groups.append([i])
    chosen, held = ([photos[i] for group in groups[side::2] for i in group] for side in (0, 1))
    return chosen, held


def overlay(photo: Photo, strength: np.ndarray, threshold: float, tolerance_px: float) -> np.ndarray:
    """The photo beside the map: green right, red wrong, magenta missed centre lines."""
    near = cv2.dilate(photo.wire.astype(np.uint8), disc(tolerance_px)) > 0
    shown = strength >= threshold
    reached = cv2.dilate(shown.astype(np.uint8), disc(tolerance_px)) > 0
    marked = photo.image // 2
    marked[cv2.dilate((skeletonize(photo.wire) & ~reached).astype(np.uint8), disc(1)) > 0] = (255, 0, 255)
    marked[shown & near] = (0, 255, 0)
    marked[shown & ~near] = (255, 0, 0)
    return np.hstack([photo.image, marked])


@dataclass(frozen=True)
class Arguments:
    """Measure wire maps."""

    data: Annotated[Path, tyro.conf.Positional]
    """Folder with images/, wire/ and mast/, or a scene folder with wire masks."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the tables and pictures."""
    tolerance_px: float = 3.0
    """How far a pixel may lie from where it belongs."""
    only: tuple[str, ...] = ()
    """Maps to measure; all when left out."""
    pictures: int = 5
    """So many of the best and of the worst photos are drawn."""


def main(arguments: Arguments) -> None:
    """Measures all maps on both halves, and writes tables and pictures."""
    cv2.setNumThreads(1)
    arguments.out.mkdir(parents=True, exist_ok=True)
    chosen, held = halves(read_photos(arguments.data))
    sides = {"chosen": chosen, "held out": held, "both": [*chosen, *held]}
    report: dict[str, Any] = {"circumstances": circumstances("cpu"), "tolerance_px": arguments.tolerance_px}
    report["photos"] = {side: [photo.name for photo in photos] for side, photos in sides.items()}
    report["maps"] = {}
    rows: dict[tuple[str, bool], list[tuple[str, ...]]] = {}
    for name in arguments.only or MAPS:
        MAPS[name](chosen[0].image)  # compiles, or loads what was compiled
        start = time.perf_counter()
        maps = {photo.name: MAPS[name](photo.image) for photo in sides["both"]}
        milliseconds = 1000 * (time.perf_counter() - start) / len(maps)
        entry: dict[str, Any] = {"ms": milliseconds}
        report["maps"][name] = entry
        for masts in (True, False)[: 1 + any(photo.mast.any() for photo in sides["both"])]:

            def all_of(photos: list[Photo], maps: dict = maps, masts: bool = masts) -> list[Judged]:
                return [judge(maps[photo.name], photo, arguments.tolerance_px, masts) for photo in photos]

            fixed = score(all_of(chosen)).threshold
            for side, photos in sides.items():
                judged = all_of(photos)
                best, at_fixed = score(judged), score(judged, fixed)
                words = f"{side}, {'with' if masts else 'without'} masts"
                entry[words] = {"best": asdict(best), "fixed": asdict(at_fixed)}
                numbers = (best.average_precision, best.f1, best.precision, best.recall, at_fixed.f1)
                tops = (best.top_precision, best.top_recall)
                cells = (name, *(f"{number:.3f}" for number in (*numbers, *tops)), figure(milliseconds, 2))
                rows.setdefault((side, masts), []).append(cells)
                if masts and side == "both":
                    single = {p.name: score([j], fixed) for p, j in zip(photos, judged, strict=True)}
                    entry["photos"] = {key: asdict(one) for key, one in single.items()}
                    if name == OURS:
                        draw(photos, maps, single, arguments)
    columns = ("map", "AP", "best F1", "precision", "recall", "F1 at the chosen half's threshold")
    columns = (*columns, "precision, top 10 %", "recall, top 10 %", "ms a photo")
    tables = [
        Table(f"{side}, {'with' if masts else 'without'} masts: {len(sides[side])} photos", columns, tuple(r))
        for (side, masts), r in rows.items()
    ]
    (arguments.out / "wire_maps.md").write_text("\n".join(table.markdown() for table in tables))
    (arguments.out / "wire_maps.json").write_text(json.dumps(report, indent=1))
    print((arguments.out / "wire_maps.md").read_text())


def draw(photos: Sequence[Photo], maps: dict, single: dict[str, Score], arguments: Arguments) -> None:
    """Overlays of the best and the worst, and their names."""
    ranked = sorted(photos, key=lambda photo: single[photo.name].f1)
    count = min(arguments.pictures, len(ranked) // 2)
    for word, some in (("worst", ranked[:count]), ("best", ranked[::-1][:count])):
        for i, photo in enumerate(some):
            one = single[photo.name]
            drawn = overlay(photo, maps[photo.name], one.threshold, arguments.tolerance_px)
            cv2.imwrite(str(arguments.out / f"{word}-{i}-{Path(photo.name).stem}.png"), drawn[..., ::-1])
            print(f"{word} {photo.name}: F1 {one.f1:.3f}, precision {one.precision:.3f}, {one.recall:.3f}")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
