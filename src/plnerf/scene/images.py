"""All pixels of a scene in one flat memory map on disk: reading.  ``build_store.py`` writes it.

Letters: n images, r pixels.  A *flat* index counts pixels over all images in order, row by row: image i has
the flat indices starts[i] to starts[i+1] - 1.  Pixel centres are at +0.5.  Colours are as stored (sRGB, not
linearised).

Memory: `RESIDENT_BYTES` of the file at most are mapped at a time, then they are given back; images are never
all in memory.  What the operating system caches of the file beyond that it can drop at any time.
"""

import mmap
import os
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

RESIDENT_BYTES = 1 << 30
"""What may be mapped of a file before it is given back: mapped pages count as a process's memory, though the
system only caches them."""


class _PixelFile:
    """The bytes of a file, read-only, one row for each pixel, of which a bounded part is mapped at a time."""

    def __init__(self, path: Path, pixels: int, width: int) -> None:
        self._file = path.open("rb", buffering=0)
        self._map = mmap.mmap(self._file.fileno(), pixels * width, access=mmap.ACCESS_READ)
        self._rows: UInt8[np.ndarray, "p c"] = np.frombuffer(self._map, np.uint8).reshape(pixels, width)
        self._read = 0

    def stretch(self, first: int, last: int) -> UInt8[np.ndarray, "n c"]:
        """Rows that follow each other, as a view of the file; views of before stay valid."""
        rows = self._rows[first:last]
        self._read += rows.nbytes
        if self._read > RESIDENT_BYTES:
            if hasattr(mmap, "MADV_DONTNEED"):  # not on Windows
                self._map.madvise(mmap.MADV_DONTNEED)
            self._read = rows.nbytes
        return rows

    @property
    def one_by_one(self) -> bool:
        """Whether single rows are read each by itself."""
        return self._rows.nbytes > RESIDENT_BYTES and hasattr(os, "pread")

    def pick(self, rows: Int[np.ndarray, " r"]) -> UInt8[np.ndarray, "r c"]:
        """A copy of single rows.

        Of a file that may not be mapped whole each is read by itself: around each byte that is read of a map,
        the system maps up to 2 MB.
        """
        if not self.one_by_one:
            return self._rows[rows]
        file, width, read = self._file.fileno(), self._rows.shape[1], os.pread
        if hasattr(os, "posix_fadvise"):  # a disk reads many places at once, if it knows of them
            for row in rows.tolist():
                os.posix_fadvise(file, width * row, width, os.POSIX_FADV_WILLNEED)
        some = b"".join([read(file, width, width * row) for row in rows.tolist()])
        return np.frombuffer(bytearray(some), np.uint8).reshape(len(rows), width)


class ImageStore:
    """Read access to the pixels of all images at the training resolution; see the module text for its
    memory."""

    def __init__(self, folder: Path, sizes_px: Int[np.ndarray, "n 2"]) -> None:
        """Opens a finished store; ``build_store.open_store`` is the way to get one."""
        self.sizes_px = sizes_px
        self.starts = np.concatenate([[0], np.cumsum(sizes_px[:, 0] * sizes_px[:, 1])]).astype(np.int64)
        pixels = int(self.starts[-1])
        self._pixels = _PixelFile(folder / "images.u8", pixels, 3)
        valid = folder / "valid.u8"
        self._valid = _PixelFile(valid, pixels, 1) if valid.exists() else None
        self._starts = torch.from_numpy(self.starts)
        self._widths = torch.from_numpy(sizes_px[:, 0].astype(np.int64))

    def __len__(self) -> int:
        return len(self.sizes_px)

    @property
    def waits_for_disk(self) -> bool:
        """Whether colours of single pixels are read from the file, which holds more than may be mapped."""
        return self._pixels.one_by_one

    @property
    def has_masks(self) -> bool:
        """Whether any image has pixels to be ignored marked by a mask file."""
        return self._valid is not None

    def image(self, i: int) -> UInt8[np.ndarray, "h w 3"]:
        """The pixels of image i: a read-only view of the file, not a copy."""
        width, height = self.sizes_px[i]
        rows = self._pixels.stretch(int(self.starts[i]), int(self.starts[i + 1]))
        grid: UInt8[np.ndarray, "h w 3"] = rows.reshape(height, width, 3)
        return grid

    def valid(self, i: int) -> Bool[np.ndarray, "h w"]:
        """False where a mask says "ignore": a pixel is valid only if all full-size pixels under it are."""
        width, height = self.sizes_px[i]
        if self._valid is None:
            return np.ones((height, width), dtype=np.bool_)
        usable: Bool[np.ndarray, "p 1"] = (
            self._valid.stretch(int(self.starts[i]), int(self.starts[i + 1])) != 0
        )
        return usable.reshape(height, width)

    def colours(self, flat: Int[Tensor, "r"]) -> Float[Tensor, "r 3"]:
        """Colours in [0, 1] at flat pixel indices (of any image), on the indices' device."""
        rows = torch.from_numpy(self._pixels.pick(flat.cpu().numpy()))
        return rows.to(flat.device).float() / 255.0

    def mean_colours(self, flat: Int[Tensor, "r"], side: int) -> Float[Tensor, "r 3"]:
        """Mean colours of squares of so many pixels a side, an odd number, around flat pixel indices.

        Beyond an image's edge its outermost pixels are repeated.  What a mask ignores does not count,
        unless it is all there is.
        """
        starts, sizes = self._starts.to(flat.device), torch.from_numpy(self.sizes_px).to(flat.device)
        image, pixel_px = self.locate(flat)
        steps = torch.arange(side, device=flat.device) - side // 2
        cells = [
            (at.long()[:, None] + steps).clamp(min=0).minimum(size[:, None] - 1)
            for at, size in zip(pixel_px.unbind(-1), sizes[image].unbind(-1), strict=True)
        ]
        rows = cells[1] * sizes[image, :1] + starts[image, None]
        square = (rows[:, :, None] + cells[0][:, None, :]).flatten()
        counts = self.valid_flat(square).view(len(flat), -1, 1).float()
        counts = torch.where(counts.sum(1, keepdim=True) > 0, counts, 1.0)
        colours = self.colours(square).view(len(flat), -1, 3)
        return (colours * counts).sum(1) / counts.sum(1)

    def valid_flat(self, flat: Int[Tensor, "r"]) -> Bool[Tensor, "r"]:
        """``valid`` at flat pixel indices."""
        if self._valid is None:
            return torch.ones_like(flat, dtype=torch.bool)
        return torch.from_numpy(self._valid.pick(flat.cpu().numpy())[:, 0] != 0).to(flat.device)

    def locate(self, flat: Int[Tensor, "r"]) -> tuple[Int[Tensor, "r"], Float[Tensor, "r 2"]]:
        """Image index and pixel centre (x + 0.5, y + 0.5) of flat pixel indices.  Indices are not
        range-checked."""
        starts, widths = self._starts.to(flat.device), self._widths.to(flat.device)
        image = torch.searchsorted(starts, flat, right=True) - 1
        within, width = flat - starts[image], widths[image]
        return image, torch.stack([within % width, within // width], dim=-1).float() + 0.5
