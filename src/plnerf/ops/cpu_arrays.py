"""Where torch hands over to Numba: tensors as flat arrays, how many threads, gradients added in place."""

import os

import numba
import numpy as np
import torch
from jaxtyping import Shaped
from torch import Tensor

FAST = {"contract", "nsz", "arcp"}
"""Fast-math flags of all kernels: fused multiply-add, but infinities and NaN keep their meaning."""


def num_threads() -> int:
    """Threads that share a kernel's work.  Called outside of kernels, which would not be cached otherwise."""
    return int(numba.get_num_threads())


def usable_cores() -> int:
    """Cores that this process may use: a container or `taskset` may leave it fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def array(tensor: Shaped[Tensor, "*n"]) -> Shaped[np.ndarray, "*n"]:
    """The tensor's numbers, without a copy where it is contiguous."""
    return tensor.detach().contiguous().numpy()


def flat(tensor: Shaped[Tensor, "..."]) -> Shaped[np.ndarray, " n"]:
    """The tensor's numbers in one row, without a copy where it is contiguous.

    Flat, so that a kernel's strides are constants to the compiler.
    """
    return array(tensor).reshape(-1)


def adds_in_place(parameter: Shaped[Tensor, "..."]) -> bool:
    """Whether a backward pass may add to `parameter.grad` itself, as autograd would do.

    A fresh array of a table's size at each step costs more, in page faults alone, than the gradient itself:
    up to 40 % of a training step was spent on it.  Only for a leaf whose gradient is there already,
    contiguous, and not while a graph of the gradient is made.
    """
    there = parameter.is_leaf and parameter.grad is not None and parameter.grad.is_contiguous()
    return there and not torch.is_grad_enabled()
