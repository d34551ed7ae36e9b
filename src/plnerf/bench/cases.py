"""All ops that are measured, at the shapes of a training step and, for the hash encoding, of Instant-NGP.

An op is added as one more `OpCase` in the list of its room: `hash_cases.py`, `ray_cases.py`, or a new one.
"""

from plnerf.bench.case import OpCase
from plnerf.bench.hash_cases import hash_cases
from plnerf.bench.ray_cases import network_case, ray_cases
from plnerf.ops import reference
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels

RAYS, PROPOSALS, FINAL = 512, (64, 32), 24
"""Rays of a step, and intervals of the two proposal rounds and the final one."""


def op_cases(backend: Backend, *, small: bool = False) -> list[OpCase]:
    """All cases of a backend that has kernels of its own.  small: shapes for tests."""
    rays = 16 if small else RAYS
    cases = hash_cases(backend, rays, PROPOSALS[0], FINAL, small=small)
    if kernels(backend).ray_mlp is not reference.ray_mlp:
        cases.append(network_case(backend, rays, FINAL))
    if kernels(backend).on_rays is not None:
        cases += ray_cases(backend, rays, PROPOSALS[0], FINAL)
    return cases
