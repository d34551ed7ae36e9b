"""Pairs of images matched once for both, and the depth maps of all views that follow from them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.survey.test_stereo import CONFIG, DISTANCE, cast, check, row_of_cameras, taken, views_of

from plnerf.survey.stereo import depth_maps as module
from plnerf.survey.stereo.depth import DepthMap, agreed
from plnerf.survey.stereo.depth_maps import depth_maps
from plnerf.survey.stereo.pair import match_pair
from plnerf.survey.stereo.stereo_views import Picture, View


def turned(view: View, degrees: float) -> View:
    """About its own axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return replace(view, R_line_camera=view.R_line_camera @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 160.0])
def test_both_images_of_a_pair_get_the_depths_of_what_they_show(turn_deg: float) -> None:
    """About as many pixels on either side, and no less exact, however the second camera is turned."""
    first, second, _ = views_of(row_of_cameras())
    second = turned(second, turn_deg)
    found = match_pair(taken(first), taken(second), DISTANCE, CONFIG.match)
    shares = []
    for shown, view in zip(found, (first, second), strict=True):
        true = cast(view)[0]
        known = np.isfinite(shown.w) & np.isfinite(true)
        shares.append(known.sum() / np.isfinite(true).sum())
        score = np.abs(shown.w - 1 / true)[known] / shown.sigma[known]
        assert np.median(score) < 1 and np.quantile(score, 0.9) < 2.5
        assert (np.isnan(shown.w) == np.isnan(shown.sigma)).all()
    assert min(shares) > 0.6 and abs(np.log(shares[0] / shares[1])) < 0.1


def mapped(views: Sequence[View], near: list[dict[int, float]]) -> dict[int, DepthMap | None]:
    pictures = [taken(view) for view in views]
    return dict(depth_maps(near, pictures.__getitem__, lambda _, depths: depths, CONFIG.match))


def test_a_view_has_the_pairs_for_which_another_has_chosen_it() -> None:
    """The first has chosen two; each of these has its own one, and that with the first."""
    views = views_of(row_of_cameras((0.0, 0.1, -0.1)))
    found = mapped(views, [{1: DISTANCE, 2: DISTANCE}, {2: DISTANCE}, {}])
    assert sorted(found) == [0, 1, 2]
    for k, depths in found.items():
        assert depths is not None
        check(depths, cast(views[k])[0], 0.5)
    alone = mapped(views, [{1: DISTANCE}, {}, {}])
    assert all(depths is None for depths in alone.values()) and sorted(alone) == [0, 1, 2]


def test_each_pair_is_matched_once_down_to_the_nearest_of_both(monkeypatch: pytest.MonkeyPatch) -> None:
    matched: list[tuple[float, float, float]] = []

    def counted(one: Picture, other: Picture, near: float, config: object) -> object:
        matched.append((one.view.centre[0], other.view.centre[0], near))
        return match_pair(one, other, near, CONFIG.match)

    monkeypatch.setattr(module, "match_pair", counted)
    views = views_of(row_of_cameras())
    mapped(views, [{1: 2.0, 2: 2.0}, {0: 1.5, 2: 2.0}, {1: 1.2}])
    x = [view.centre[0] for view in views]
    assert sorted(matched) == sorted([(x[0], x[1], 1.5), (x[0], x[2], 2.0), (x[1], x[2], 1.2)])


def test_maps_are_the_same_on_any_number_of_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    views = views_of(row_of_cameras((0.0, 0.15, -0.2, 0.3)))
    near = [{(k + 1) % 4: DISTANCE, (k + 2) % 4: DISTANCE} for k in range(4)]
    found = []
    for cores in (1, 3):
        monkeypatch.setattr(module, "usable_cores", lambda cores=cores: cores)
        found.append(mapped(views, near))
    assert list(found[0]) == list(found[1])
    for one, same in zip(found[0].values(), found[1].values(), strict=True):
        assert one is not None and same is not None
        assert (np.nan_to_num(one.t) == np.nan_to_num(same.t)).all()


def test_views_of_two_passes_follow_one_another_across_the_passes() -> None:
    """Else the second pass would have to begin before the first pairs could be forgotten."""
    n = 50
    pairs = [(k, n + k) for k in range(n)]
    pairs += [(side + k, side + k + 1) for side in (0, n) for k in range(n - 1)]
    place = np.argsort(module._order(2 * n, pairs))
    assert max(abs(place[i] - place[j]) for i, j in pairs) <= 3


def test_an_error_in_a_picture_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(k: int) -> Picture:
        raise ValueError(f"image {k}")

    with pytest.raises(ValueError, match="image"):
        list(depth_maps([{1: 1.0, 2: 1.0}, {}, {}], broken, lambda _, depths: depths, CONFIG.match))


def test_of_pairs_that_agree_the_most_exact_count_most() -> None:
    """Beside a third that says something else, and one that is silent."""
    first, second, third = views_of(row_of_cameras())
    pairs = [match_pair(taken(first), taken(view), DISTANCE, CONFIG.match)[0] for view in (second, third)]
    one = pairs[0]
    exact = replace(one, w=one.w + np.float32(0.01), sigma=one.sigma / np.float32(3))
    other, silent = replace(one, w=one.w * np.float32(2)), replace(one, w=np.full_like(one.w, np.nan))
    depths = agreed([one, exact, other, silent], CONFIG.match)
    known = np.isfinite(depths.t)
    assert (known == np.isfinite(one.w)).all()
    assert 1 / depths.t[known] == pytest.approx(one.w[known] + 0.009, abs=1e-4)
    w_sigma = (depths.sigma / depths.t**2)[known]
    assert w_sigma == pytest.approx(np.maximum(exact.sigma[known], 0.003), rel=0.01)
