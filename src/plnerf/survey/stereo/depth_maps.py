"""The depth maps of all views, each pair of images matched once for both of them.

The matcher costs nearly all of the time of stereo, and what it finds in one image of a pair it has found in
the other too.  So a view also has the pairs in which it was chosen by another one.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from plnerf.ops.cpu_arrays import usable_cores
from plnerf.survey.stereo.config import MatchConfig
from plnerf.survey.stereo.depth import DepthMap, agreed
from plnerf.survey.stereo.pair import Shown, match_pair
from plnerf.survey.stereo.stereo_views import Picture

T = TypeVar("T")
Pair = tuple[int, int]


def depth_maps(
    near: Sequence[Mapping[int, float]],
    picture: Callable[[int], Picture],
    finish: Callable[[int, DepthMap], T],
    config: MatchConfig,
) -> Iterator[tuple[int, T | None]]:
    """Index of each view, and what `finish` makes of it and its depth map; None without two pairs.

    near: of each view its partners, with the distance of what is near in it.  picture: reads that of a view.
    Both functions are called on all cores at a time, the pairs of a view soon after one another, which bounds
    memory; results do not depend on the number of cores.
    """
    pairs: dict[Pair, float] = {}
    for i, partners in enumerate(near):
        for j, distance in partners.items():
            pair = (min(i, j), max(i, j))
            pairs[pair] = min(distance, pairs.get(pair, distance))
    of_view: list[list[Pair]] = [[] for _ in near]
    for pair in pairs:
        for i in pair:
            of_view[i].append(pair)

    def matched(pair: Pair) -> tuple[Shown, Shown]:
        return match_pair(picture(pair[0]), picture(pair[1]), pairs[pair], config)

    def finished(i: int, work: Sequence[tuple[int, Future[tuple[Shown, Shown]]]]) -> T | None:
        shown = [pair.result()[side] for side, pair in work]
        return None if len(shown) < 2 else finish(i, agreed(shown, config))

    with ThreadPoolExecutor(usable_cores()) as pool:
        # Pairs begin in this order too, so that none of those that a view waits for waits itself.
        begun: dict[Pair, Future[tuple[Shown, Shown]]] = {}
        waiting: deque[tuple[int, Future[T | None]]] = deque()
        for i in _order(len(near), list(pairs)):
            for pair in of_view[i]:
                if pair not in begun:
                    begun[pair] = pool.submit(matched, pair)
            work = [(pair.index(i), begun[pair]) for pair in of_view[i]]
            waiting.append((i, pool.submit(finished, i, work)))
        begun.clear()
        while waiting:
            i, future = waiting.popleft()
            yield i, future.result()


def _order(count: int, pairs: Sequence[Pair]) -> list[int]:
    """Views such that those of a pair are near to each other, however the flight went (E. Cuthill, J. McKee,
    "Reducing the bandwidth of sparse symmetric matrices", 1969)."""
    i, j = np.array(pairs, np.int32).reshape(-1, 2).T
    graph = coo_array((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])), shape=(count, count))
    order: list[int] = reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True).tolist()
    return order
