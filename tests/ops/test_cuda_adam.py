"""The Triton kernel of Adam on tables is the reference: interpreted on a CPU, or run on a GPU."""

import pytest
import torch
from tests.train.test_optimizer import SETTINGS, make_table

from plnerf.ops import cuda_adam, reference


@pytest.mark.parametrize("features", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
def test_kernel_agrees_with_the_reference(device: str, features: int, dtype: torch.dtype) -> None:
    """On tables that do and do not fill blocks; rate and step as numbers and as tensors of the device."""
    tolerance = 1e-6 if dtype == torch.float32 else 1e-14
    for rows in (1, 2500 // features):
        truth, found = ([t.to(device) for t in make_table(rows, features, dtype)] for _ in range(2))
        for step in (1, 2, 1000):
            for tensors in (truth, found):
                tensors[1].copy_(make_table(rows, features, dtype, seed=step)[1])
            reference.adam_rows(*truth, step=step, **SETTINGS)
            numbers = {**SETTINGS, "step": step}
            if step == 2:
                for name in ("step", "rate"):
                    numbers[name] = torch.tensor(numbers[name], dtype=torch.float64, device=device)
            cuda_adam.adam_rows(*found, **numbers)
            for a, b in zip(found, truth, strict=True):
                torch.testing.assert_close(a, b, atol=tolerance * float(b.abs().max()), rtol=0)
            assert not found[1].any()


def test_rows_without_a_gradient_keep_their_bits_and_not_a_number_is_one(device: str) -> None:
    """A NaN that is silently skipped would hide that training has failed."""
    before = [t.to(device) for t in make_table(300, 4)]
    before[1][7, 2] = float("nan")
    after = [t.clone() for t in before]
    cuda_adam.adam_rows(*after, step=3, **SETTINGS)
    still = ~(before[1] != 0).any(-1)
    assert 0 < int(still.sum()) < 300 and not still[7]
    for k in (0, 2, 3):
        assert torch.equal(before[k][still], after[k][still])
        assert bool((before[k] != after[k])[~still].any(-1).all())
    assert after[0][7, 2].isnan()


def test_what_cannot_be_changed_in_place_is_refused(device: str) -> None:
    param, grad, m, v = (t.to(device) for t in make_table(8, 4))
    for wrong in (grad.t().contiguous().t(), grad.double()):
        with pytest.raises(ValueError, match="contiguous tensors of one type"):
            cuda_adam.adam_rows(param, wrong, m, v, step=1, **SETTINGS)
