"""All pixels of a scene in one flat memory map on disk: reading.  ``build_store.py`` writes it.

Letters: n images, r pixels.  A *flat* index counts pixels over all images in order, row by row: image i has
the flat indices starts[i] to starts[i+1] - 1.  Pixel centres are at +0.5.  Colours are as stored (sRGB, not
linearised).

Memory: only what the operating system chooses to cache of the file, which it can drop at any time; images are
never all in memory.
"""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor


class ImageStore:
    """Read access to the pixels of all images at the training resolution; see the module text for its
    memory."""

    def __init__(self, folder: Path, sizes_px: Int[np.ndarray, "n 2"]) -> None:
        """Opens a finished store; ``build_store.open_store`` is the way to get one."""
        self.sizes_px = sizes_px
        self.starts = np.concatenate([[0], np.cumsum(sizes_px[:, 0] * sizes_px[:, 1])]).astype(np.int64)
        self._pixels: UInt8[np.ndarray, "p 3"] = np.asarray(
            np.memmap(folder / "images.u8", np.uint8, mode="r", shape=(int(self.starts[-1]), 3))
        )
        valid = folder / "valid.u8"
        self._valid: UInt8[np.ndarray, p] | None = None
        if valid.exists():
            self._valid = np.asarray(np.memmap(valid, np.uint8, mode="r", shape=(int(self.starts[-1]),)))
        self._starts = torch.from_numpy(self.starts)
        self._widths = torch.from_numpy(sizes_px[:, 0].astype(np.int64))

    def __len__(self) -> int:
        return len(self.sizes_px)

    @property
    def has_masks(self) -> bool:
        """Whether any image has pixels to be ignored marked by a mask file."""
        return self._valid is not None

    def image(self, i: int) -> UInt8[np.ndarray, "h w 3"]:
        """The pixels of image i: a read-only view of the file, not a copy."""
        width, height = self.sizes_px[i]
        rows: UInt8[np.ndarray, "p 3"] = self._pixels[self.starts[i] : self.starts[i + 1]]
        grid: UInt8[np.ndarray, "h w 3"] = rows.reshape(height, width, 3)
        return grid

    def valid(self, i: int) -> Bool[np.ndarray, "h w"]:
        """False where a mask says "ignore": a pixel is valid only if all full-size pixels under it are."""
        width, height = self.sizes_px[i]
        if self._valid is None:
            return np.ones((height, width), dtype=np.bool_)
        usable: Bool[np.ndarray, p] = self._valid[self.starts[i] : self.starts[i + 1]] != 0
        return usable.reshape(height, width)

    def colours(self, flat: Int[Tensor, "r"]) -> Float[Tensor, "r 3"]:
        """Colours in [0, 1] at flat pixel indices (of any image), on the indices' device."""
        rows = torch.from_numpy(self._pixels[flat.cpu().numpy()])
        return rows.to(flat.device).float() / 255.0

    def valid_flat(self, flat: Int[Tensor, "r"]) -> Bool[Tensor, "r"]:
        """``valid`` at flat pixel indices."""
        if self._valid is None:
            return torch.ones_like(flat, dtype=torch.bool)
        return torch.from_numpy(self._valid[flat.cpu().numpy()] != 0).to(flat.device)

    def locate(self, flat: Int[Tensor, "r"]) -> tuple[Int[Tensor, "r"], Float[Tensor, "r 2"]]:
        """Image index and pixel centre (x + 0.5, y + 0.5) of flat pixel indices.  Indices are not
        range-checked."""
        starts, widths = self._starts.to(flat.device), self._widths.to(flat.device)
        image = torch.searchsorted(starts, flat, right=True) - 1
        within, width = flat - starts[image], widths[image]
        return image, torch.stack([within % width, within // width], dim=-1).float() + 0.5
