"""Where Triton's kernels run."""

import os
from collections.abc import Iterator

import pytest
import torch

from plnerf.ops import cuda_hash

INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1"


@pytest.fixture(params=["interpreted", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Where the kernels run.  Triton interprets all kernels of a process or none.

    Interpreted, a sum over the points of a block goes point by point in Python: blocks are small there.
    """
    if request.param == "interpreted":
        if not INTERPRETED:
            pytest.skip("beside a GPU, kernels are interpreted only with TRITON_INTERPRET=1")
        monkeypatch.setattr(cuda_hash, "BLOCK", 8)
        yield "cpu"
    else:
        if INTERPRETED or not torch.cuda.is_available():
            pytest.skip("no CUDA device, or TRITON_INTERPRET=1")
        yield "cuda"
