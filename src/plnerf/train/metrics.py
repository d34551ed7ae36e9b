"""How alike a render and a photo are.

Letters: h rows, w columns.  Colours are in [0, 1] as stored (sRGB).
"""

import importlib.util
import math

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Generator, Tensor

from plnerf.rays.rays import pixel_rays
from plnerf.render.system import RadianceSystem
from plnerf.render.views import default_chunk
from plnerf.scene.scene import Scene

SSIM_WINDOW = (
    "Gaussian of 1.5 px in a window of 11x11 px, data range 1, mean over the pixels at least 5 px inside"
)
NEAR_WIRE_PX = 3
"""What lies this near to a wire's pixels shows whether it is a line on its background."""
LPIPS_ABSENT = "not computed: needs the extra plnerf[lpips]"


def psnr_of_mse(mse: float) -> float:
    """Peak signal-to-noise ratio in dB of a mean squared error at peak 1; infinite for an error of 0."""
    return -10 * math.log10(mse) if mse > 0 else math.inf


def psnr(
    render: Float[np.ndarray, "h w 3"], photo: Float[np.ndarray, "h w 3"], use: Bool[np.ndarray, "h w"]
) -> float | None:
    """PSNR in dB over the pixels in use, in float64; infinite where they are equal, None without any."""
    if not use.any():
        return None
    return psnr_of_mse(float(np.mean((render[use].astype(np.float64) - photo[use].astype(np.float64)) ** 2)))


def ssim(
    render: Float[np.ndarray, "h w 3"], photo: Float[np.ndarray, "h w 3"], valid: Bool[np.ndarray, "h w"]
) -> float | None:
    """Structural similarity (Wang et al. 2004; window in `SSIM_WINDOW`), mean over the valid pixels."""
    return mean_inside(ssim_map(render, photo, valid), valid)


def ssim_map(
    render: Float[np.ndarray, "h w 3"], photo: Float[np.ndarray, "h w 3"], valid: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Structural similarity at every pixel, the mean of the colours'.

    Ignored pixels take the photo's colours first, so that they say nothing about their neighbours either.
    """
    from torchmetrics.functional.image import structural_similarity_index_measure  # takes a second to import

    filled = np.where(valid[..., None], render, photo)
    _, per_pixel = structural_similarity_index_measure(
        _batch(filled), _batch(photo), data_range=1.0, sigma=1.5, return_full_image=True
    )
    similarity: Float[np.ndarray, "h w"] = per_pixel[0].double().mean(0).numpy()
    return similarity


def mean_inside(similarity: Float[np.ndarray, "h w"], use: Bool[np.ndarray, "h w"]) -> float | None:
    """Mean of `ssim_map` over the pixels in use whose window lies inside the image; None without any."""
    inner = (slice(5, -5), slice(5, -5))
    if not use[inner].any():
        return None
    return float(similarity[inner][use[inner]].mean())


class Lpips:
    """Learned perceptual image patch similarity (Zhang et al. 2018), AlexNet; needs plnerf[lpips]."""

    def __init__(self) -> None:
        self._metric = None
        self.absent: str | None = None
        """Why nothing is computed, or None."""
        if importlib.util.find_spec("torchvision") is None:
            self.absent = LPIPS_ABSENT
            return
        from torchmetrics.image.lpip import LearnedPerceptualImagePatchSimilarity

        try:
            self._metric = LearnedPerceptualImagePatchSimilarity(net_type="alex", normalize=True)
        except OSError as error:  # torchvision downloads the network's weights on first use
            self.absent = f"not computed: the weights of AlexNet could not be fetched ({error})"

    def __call__(
        self,
        render: Float[np.ndarray, "h w 3"],
        photo: Float[np.ndarray, "h w 3"],
        valid: Bool[np.ndarray, "h w"],
    ) -> float | None:
        """The distance, 0 for equal pictures; ignored pixels take the photo's colours.  None if absent."""
        if self._metric is None:
            return None
        filled = np.where(valid[..., None], render, photo)
        with torch.inference_mode():
            return float(self._metric(_batch(filled), _batch(photo)))


def _batch(picture: Float[np.ndarray, "h w 3"]) -> Float[Tensor, "1 3 h w"]:
    return torch.from_numpy(picture.astype(np.float32)).permute(2, 0, 1)[None]


def held_out_pixels(scene: Scene, count: int, generator: Generator) -> Int[Tensor, " n"]:
    """Flat indices of random pixels of the held-out images."""
    test = list(scene.test)
    ends = torch.from_numpy(np.cumsum(np.diff(scene.images.starts)[test]))
    within = torch.randint(int(ends[-1]), (count,), generator=generator)
    slot = torch.searchsorted(ends, within, right=True)
    before = torch.where(slot > 0, ends[slot - 1], 0)
    return torch.from_numpy(scene.images.starts[test])[slot] + within - before


def some_of(pixels: Int[np.ndarray, " d"], count: int, generator: Generator) -> Int[Tensor, " n"]:
    """Random ones of given pixels, each once at most."""
    return torch.from_numpy(pixels)[torch.randperm(len(pixels), generator=generator)[:count]]


def validation_psnr(model: RadianceSystem, scene: Scene, flat: Int[Tensor, " n"]) -> float:
    """PSNR in dB over pixels, given by their flat indices, without those that masks ignore; NaN where none
    is left.

    The appearance vector is the mean of the training images'.  Leaves the model's mode as it is and records
    no gradients.
    """
    flat = flat[scene.images.valid_flat(flat)]
    camera, pixel_px = scene.images.locate(flat)
    rays = pixel_rays(scene.cameras, camera, pixel_px)
    device, chunk = model.appearance.device, default_chunk(model)
    squared, count = 0.0, 0
    with torch.no_grad():
        train = torch.tensor(scene.train, device=device)
        for first in range(0, len(rays), chunk):
            part = slice(first, first + chunk)
            some = rays[part].to(device)
            out = model(some, appearance=model.mean_appearance(len(some), train))
            error = out.colour.cpu().clamp(0, 1) - scene.images.colours(flat[part])
            squared, count = squared + float(error.double().square().sum()), count + error.numel()
    return psnr_of_mse(squared / count) if count else math.nan
