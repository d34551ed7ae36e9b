"""The optimiser: Adam as Instant-NGP sets it; rows of hash tables that no sample touched are left alone.

It has the methods of `torch.optim.Optimizer` that training uses, but is none: making one imports torch's
compiler, which takes two seconds.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor
from torch.optim.adam import adam

from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels
from plnerf.render.system import RadianceSystem
from plnerf.train.config import TrainConfig


def build_optimizer(model: RadianceSystem, cfg: TrainConfig) -> "TableAdam":
    """A group each for hash tables, networks, appearance vectors and, where refined, poses.

    From here on gradients are there.
    """
    tables = [value for name, value in model.named_parameters() if name.endswith("table")]
    poses = list(model.poses.parameters())
    others = {id(value) for value in (*tables, *poses, model.appearance)}
    networks = [value for value in model.parameters() if id(value) not in others]
    for value in model.parameters():
        value.grad = torch.zeros_like(value)
    groups = [
        {"params": networks, "rate": cfg.mlp_lr},
        {"params": [model.appearance], "rate": cfg.appearance_rate * cfg.mlp_lr},
    ]
    if tables:  # deep networks have none
        groups.insert(0, {"params": tables, "rate": cfg.hash_lr, "by_row": True})
    if cfg.pose_refinement:
        groups.append({"params": poses, "rate": cfg.pose_lr, "late": True})
    if model.appearance.is_cuda:  # a CUDA graph reads what changes from tensors
        groups = [{**group, "lr": torch.zeros((), device=model.appearance.device)} for group in groups]
    return TableAdam(groups, model.backend)


@runtime_checkable
class Optimizer(Protocol):
    """What a training step needs of an optimiser; those of torch have it too."""

    param_groups: list[dict[str, Any]]

    def step(self) -> object:
        """Moves the parameters by their gradients."""

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Empties the gradients, or drops them."""


class TableAdam:
    """Adam whose groups with "by_row" set hold tables, of which only rows with a gradient are stepped.

    A table is read by a few samples at a few of its rows: that its other rows stand still saves most of the
    memory traffic of a step, and keeps their moments for when they are seen again.  Stepping such a table
    empties its gradient on the way, so that `zero_grad(set_to_none=False)` need not touch it.
    Parameters of groups with "late" set may join after the others were stepped, when a run is resumed.
    """

    def __init__(self, groups: Iterable[dict[str, Any]], backend: Backend) -> None:
        usual: dict[str, Any] = {
            "lr": 1e-3, "betas": (0.9, 0.99), "eps": 1e-15, "by_row": False, "late": False,
        }  # fmt: skip
        self.param_groups: list[dict[str, Any]] = [usual | group for group in groups]
        self.state: dict[Tensor, dict[str, Tensor]] = {}
        self._adam_rows = kernels(backend).adam_rows

    @torch.no_grad()
    def step(self) -> None:
        """One step on the gradients that are there."""
        for group in self.param_groups:
            values = [value for value in group["params"] if value.grad is not None]
            states = [self._state_of(value) for value in values]
            if group["by_row"]:
                for value, state in zip(values, states, strict=True):
                    state["step"] += 1
                    self._adam_rows(
                        value, value.grad, state["exp_avg"], state["exp_avg_sq"],
                        rate=group["lr"], betas=group["betas"], eps=group["eps"], step=state["step"],
                    )  # fmt: skip
            elif values:
                with _one_thread():
                    adam(
                        values, [value.grad for value in values],
                        [state["exp_avg"] for state in states], [state["exp_avg_sq"] for state in states],
                        [], [state["step"] for state in states],
                        fused=True, amsgrad=False, maximize=False, weight_decay=0.0,
                        beta1=group["betas"][0], beta2=group["betas"][1], lr=group["lr"], eps=group["eps"],
                    )  # fmt: skip

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Empties the gradients; where they are kept, those of tables are empty since the last step."""
        for group in self.param_groups:
            if set_to_none:
                for value in group["params"]:
                    value.grad = None
            elif not group["by_row"]:
                gradients = [value.grad for value in group["params"] if value.grad is not None]
                torch._foreach_zero_(gradients)

    def state_dict(self) -> dict[int, dict[str, Tensor]]:
        """Steps and moments of each parameter that was stepped, by its place in the groups."""
        return {k: self.state[value] for k, value in enumerate(self._values()) if value in self.state}

    def layout(self) -> dict[int, dict[str, Tensor]]:
        """What `state_dict` holds once every parameter was stepped: shapes and dtypes without values."""
        return {k: self._unstepped(value, torch.device("meta")) for k, value in enumerate(self._values())}

    def late(self) -> set[int]:
        """Places of the parameters that may join after the others were stepped."""
        late = [group["late"] for group in self.param_groups for _ in group["params"]]
        return {k for k, joins in enumerate(late) if joins}

    def load_state_dict(self, state: dict[int, dict[str, Tensor]]) -> None:
        """Takes over copies of what `state_dict` gave, on each parameter's device.

        Left out is what belongs to parameters after the last: poses, where they are no longer refined.  The
        kernels trust the shapes: state that was on a disk is to be compared with `layout` before.
        """
        values = list(self._values())
        self.state = {
            values[k]: {name: part.to(values[k].device, copy=True) for name, part in parts.items()}
            for k, parts in state.items()
            if k < len(values)
        }

    def _values(self) -> Iterator[Tensor]:
        return (value for group in self.param_groups for value in group["params"])

    def _state_of(self, value: Tensor) -> dict[str, Tensor]:
        if value not in self.state:
            self.state[value] = self._unstepped(value, value.device)
        return self.state[value]

    @staticmethod
    def _unstepped(value: Tensor, device: torch.device) -> dict[str, Tensor]:
        return {
            "step": torch.zeros((), dtype=torch.float32, device=device),
            "exp_avg": torch.zeros_like(value, device=device),
            "exp_avg_sq": torch.zeros_like(value, device=device),
        }


@contextmanager
def _one_thread() -> Iterator[None]:
    """Networks are some twenty small tensors: waking a CPU's threads for each takes four times the work."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
