"""The bench of ops: reference and kernel measured in turn, the same values, work counted rightly."""

import dataclasses
import math
import time
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from plnerf.bench import (
    cases,
    ceilings,
    hash_cases,
    ops_suite,
)
from plnerf.bench.case import OpCase, Work
from plnerf.bench.timing import PairedTimes, alternate
from plnerf.errors import ConfigError, PlnerfError
from plnerf.ops import reference
from plnerf.ops.grid import GridShape

CPU = torch.device("cpu")


# -- times


def test_truth_and_twin_are_measured_in_turn() -> None:
    calls: list[str] = []

    def sample(name: str) -> tuple[float, float]:
        calls.append(name)
        return float(len(calls)), 2.0 * len(calls)

    forward, backward = alternate(lambda: sample("a"), lambda: sample("b"), least=5, seconds=0.0)
    assert calls == ["a", "b"] * 6  # one pair unmeasured
    assert forward.reference_s == (3.0, 5.0, 7.0, 9.0, 11.0)
    assert forward.kernel_s == (4.0, 6.0, 8.0, 10.0, 12.0)
    assert backward.kernel_s == tuple(2 * value for value in forward.kernel_s)


@pytest.mark.slow
@given(st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3)), min_size=1, max_size=9))
def test_a_machine_that_slows_down_for_a_whole_pair_changes_no_ratio(
    pairs: list[tuple[float, float]],
) -> None:
    """The reason for pairs: the ratio of the medians would move."""
    times = PairedTimes(*map(tuple, zip(*pairs, strict=True)))
    slowed = [(a * 2.0**i, b * 2.0**i) for i, (a, b) in enumerate(pairs)]
    assert PairedTimes(*map(tuple, zip(*slowed, strict=True))).ratio == times.ratio


def test_times_without_a_partner_are_refused() -> None:
    with pytest.raises(ConfigError, match="2 and 1"):
        PairedTimes((1.0, 2.0), (1.0,))


def test_measuring_goes_on_for_the_seconds_asked_for() -> None:
    def sample() -> tuple[float]:
        time.sleep(1e-3)
        return (1e-3,)

    begin = time.perf_counter()
    (times,) = alternate(sample, sample, least=1, seconds=0.05)
    assert time.perf_counter() - begin >= 0.05 and len(times.reference_s) <= 30


# -- ops


def doubled(x: Tensor) -> Tensor:
    return 2 * x


def case_of(kernel: Any, backward: Work | None = None) -> OpCase:
    def setup(generator: torch.Generator) -> tuple[Tensor, ...]:
        value = torch.randn(50, generator=generator)
        if backward:
            value.requires_grad_()
            value.grad = torch.zeros(50)
        return (value,)

    return OpCase("double", "50 numbers", setup, doubled, kernel, Work(400, flops=50), backward)


@pytest.fixture(scope="module")
def tiny_ceilings() -> ceilings.Ceilings:
    return ceilings.measure_ceilings([2**16], CPU, small=True, repeats=2)


def measure(case: OpCase, limits: ceilings.Ceilings) -> list[ops_suite.PassFigures]:
    return ops_suite.measure_op(case, limits, CPU, least=3, seconds=0.0, seed=0)


@pytest.mark.slow
def test_an_op_has_a_backward_pass_where_it_says_so(tiny_ceilings: ceilings.Ceilings) -> None:
    assert [one.direction for one in measure(case_of(doubled), tiny_ceilings)] == ["forward"]
    both = measure(case_of(doubled, Work(400)), tiny_ceilings)
    assert [one.direction for one in both] == ["forward", "backward"]
    assert all(one.difference == 0 for one in both)
    assert all(len(one.times.reference_s) == len(one.times.kernel_s) == 3 for one in both)


class _WrongGradient(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        return 2 * x

    @staticmethod
    def backward(ctx: Any, *g_outputs: Tensor) -> Tensor:
        return 2.01 * g_outputs[0]


@pytest.mark.parametrize(
    "kernel",
    [lambda x: 2.001 * x, lambda x: 2 * x * math.nan, _WrongGradient.apply],
    ids=["larger", "nan", "gradient"],
)
def test_a_twin_that_computes_something_else_gets_no_times(
    kernel: Any, tiny_ceilings: ceilings.Ceilings
) -> None:
    with pytest.raises(PlnerfError, match="does not compute what its reference does"):
        measure(case_of(kernel, Work(400)), tiny_ceilings)


def test_shares_are_work_over_time_over_the_ceiling(tiny_ceilings: ceilings.Ceilings) -> None:
    gather = tiny_ceilings.gather(2**16)
    work = Work(
        round(tiny_ceilings.triad.per_second),
        round(gather.per_second),
        round(tiny_ceilings.float32.per_second),
    )
    shares = ops_suite.shares_of(work, 2.0, tiny_ceilings, gather)
    assert dataclasses.astuple(shares) == pytest.approx((0.5, 0.5, 0.5))
    assert ops_suite.shares_of(work, 2.0, tiny_ceilings, None).random is None


@pytest.mark.slow
def test_every_op_of_a_step_is_a_case_and_agrees(tiny_ceilings: ceilings.Ceilings) -> None:
    """The shapes of tests; each kernel's name once, each with its work counted."""
    found = cases.op_cases("numba", small=True)
    assert len({case.name for case in found}) == len(found) >= 10
    for case in found:
        reference, kernel = (ops_suite._Run(case, op, CPU, 0) for op in (case.reference, case.kernel))
        passes = reference.sample(), kernel.sample()
        assert len(passes[0]) == len(passes[1]) == 1 + (case.backward is not None)
        for a, b in zip(reference.values(), kernel.values(), strict=True):
            assert ops_suite.difference(b, a) < case.tolerance, case.name
        for work in (case.forward, case.backward):
            assert work is None or (work.bytes_moved > 0 and work.flops > 0)
            assert work is None or (work.lines > 0) == (case.table_bytes > 0)


def test_lines_are_those_that_the_eight_corners_touch() -> None:
    """By brute force over sets; never fewer than one and never more than eight a level."""
    grid = GridShape(3, 4, 32, 4, 9)
    points = hash_cases.random_points(40)
    expected = 0
    for level, cells in enumerate(grid.resolutions):
        for point in points:
            cell = (point * cells).floor().clamp(0, cells - 1).long()
            corners = [cell + torch.tensor([c & 1, c >> 1 & 1, c >> 2]) for c in range(8)]
            rows = [int(reference.vertex_row(corner, level, grid)) for corner in corners]
            expected += len({row * 16 // 64 for row in rows})
    assert hash_cases.lines_of_points(points, grid) == expected
    assert 40 * 3 <= expected <= 40 * 3 * 8


def test_points_along_rays_lie_in_the_cube_and_on_lines() -> None:
    points = hash_cases.points_along_rays(5, 6).reshape(5, 6, 3)
    assert ((points >= 0) & (points <= 1)).all()
    inside = (points * 4 - 2).abs().amax(-1) < 1  # where the contraction is the identity
    steps = points.diff(dim=1)
    bend = torch.linalg.cross(steps[:, 1:], steps[:, :-1]).norm(dim=-1)
    straight = bend / steps.norm(dim=-1).amax(1, keepdim=True) ** 2
    assert (straight[inside[:, 2:] & inside[:, 1:-1] & inside[:, :-2]] < 1e-4).all()
    assert inside.sum() > 5
