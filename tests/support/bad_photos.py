"""Photos that nothing can be made of, as cameras, cut-off downloads and strangers leave them."""

import struct
import zlib
from pathlib import Path

import numpy as np
from PIL import Image


def write_bad_photos(folder: Path) -> set[str]:
    """Writes one photo of each kind into a folder; returns their names."""
    Image.new("RGB", (1, 1)).save(folder / "one-pixel.png")
    Image.new("RGB", (5000, 3)).save(folder / "strip.png")
    (folder / "200-megapixels.png").write_bytes(png_that_states(20_000, 10_000))
    (folder / "hollow.png").write_bytes(png_that_states(800, 600))
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    for suffix in ("jpg", "png", "tif", "webp"):
        path = folder / f"cut-off.{suffix}"
        Image.fromarray(noise).save(path)
        path.write_bytes(path.read_bytes()[:600])
    (folder / "empty.jpg").write_bytes(b"")
    (folder / "text.jpg").write_text("not a photo")
    return {path.name for path in folder.iterdir()}


def png_that_states(width: int, height: int) -> bytes:
    """A file whose header states a size, with hardly a pixel after it."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(100))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
