"""What a camera does to a picture: exposure, colour balance and noise.

Letters: L linear radiance scaled so that 1 is white in sRGB, `h w 3`; n views in time order.  Everything acts
on L, before the sRGB curve.  Each function is pure; what is random takes its generator as an argument.
"""

import numpy as np
from jaxtyping import Float

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB (IEC 61966-2-1)
MID_GREY = 0.18
FOLLOW = 0.35  # share of the way to the exposure asked for that a camera goes from one image to the next
READ_SHARE = 0.02  # the L at which shot noise is as large as read noise


def luminance(linear: Float[np.ndarray, "h w 3"]) -> float:
    """Mean luminance of a picture."""
    return float((linear @ LUMINANCE).mean())


def next_gain(before: float | None, mean_luminance: float) -> float:
    """The gain of the next view as automatic exposure follows the scene.

    What is asked for is MID_GREY / mean luminance; the camera goes the share FOLLOW of the way there, in
    stops, from the gain of the view before.  The first view (`before` is None) has all that is asked for.
    """
    asked = MID_GREY / max(mean_luminance, 1e-6)
    return asked if before is None else before * (asked / before) ** FOLLOW


def slow_drift(
    n: int, deviation: float, rng: np.random.Generator, channels: int = 1
) -> Float[np.ndarray, "n c"]:
    """Random smooth curves over n views, each with mean 0 and standard deviation `deviation` over the views.

    Three waves, of about one, two and three cycles over the flight: slow against the step between two views.
    """
    if n < 2 or deviation == 0:
        return np.zeros((n, channels))
    t = np.arange(n)[:, None] / n
    curves = np.zeros((n, channels))
    for cycles in (1.0, 2.0, 3.0):
        rate = cycles * rng.uniform(0.8, 1.2, channels)
        curves += rng.uniform(0.5, 1.0, channels) * np.sin(
            2 * np.pi * (rate * t + rng.uniform(0, 1, channels))
        )
    curves -= curves.mean(axis=0)
    return deviation * curves / curves.std(axis=0)


def exposure_drift(n: int, stops: float, rng: np.random.Generator) -> Float[np.ndarray, "n"]:
    """Gains of n views that drift slowly, by `stops` (standard deviation) around 1; 0 stops give 1."""
    return np.exp2(slow_drift(n, stops, rng)[:, 0])


def white_balance_drift(n: int, deviation: float, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Gains of red, green and blue over n views: ln(red / blue) drifts by `deviation`, green stays 1."""
    half = slow_drift(n, deviation, rng)[:, 0] / 2
    return np.exp(np.stack([half, np.zeros(n), -half], axis=1))


def sensor_noise(
    linear: Float[np.ndarray, "h w 3"], deviation: float, rng: np.random.Generator
) -> Float[np.ndarray, "h w 3"]:
    """The picture as a sensor counts it: shot noise, whose variance grows with L, and constant read noise.

    Variance deviation^2 (L + r) / (MID_GREY + r) with r = READ_SHARE, independent for each value: `deviation`
    is what mid grey has, as a part of white.  Shot noise is taken as normal, which the count of a few hundred
    photons is.  Values may turn negative; the sRGB curve clips them.
    """
    variance = (np.maximum(linear, 0.0) + READ_SHARE) / (MID_GREY + READ_SHARE)
    return linear + deviation * np.sqrt(variance) * rng.standard_normal(linear.shape)
