"""The light on hung wires: a sky that is brighter above than below, a sun, and what metals make of them.

Letters: N surface normal, V direction to the camera, S to the sun, H halfway between V and S; unit vectors
of the upright world.  Linear light, red green blue; E is what a white, level, matt surface sends out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.synth.hang_config import DrawConfig, Material

GROUND = 0.18
"""Share of the light that the ground sends back up."""
COLOURS: dict[Material, tuple[float, float, float]] = {
    "aluminium": (0.42, 0.43, 0.45),
    "weathered": (0.31, 0.32, 0.33),
    "copper": (0.16, 0.12, 0.09),
}
"""Reflectance of the matt part: bright strands, grey ones after years, and copper with its dark oxide."""
GLOSS: dict[Material, tuple[float, float]] = {
    "aluminium": (0.35, 14.0),
    "weathered": (0.15, 8.0),
    "copper": (0.1, 10.0),
}
"""Strength and exponent of the highlight, J. Blinn, "Models of light reflection for computer synthesized
pictures", SIGGRAPH 1977; strands in two directions make it broad."""


@dataclass(frozen=True, eq=False)
class Light:
    """One light for all photos."""

    to_sun: Float[np.ndarray, "3"]
    sky: float
    """Share of the sky in the light on level ground."""
    E: Float[np.ndarray, "3"]

    def on(
        self, normal: Float[np.ndarray, "p 3"], to_camera: Float[np.ndarray, "p 3"], material: Material
    ) -> Float[np.ndarray, "p 3"]:
        """What a surface of this material sends to the camera."""
        sun = (1 - self.sky) / self.to_sun[2]
        up = normal[:, 2]
        ambient = self.sky * (1 + up) / 2 + GROUND * (1 - up) / 2
        matt = ambient + sun * np.maximum(normal @ self.to_sun, 0.0)
        half = to_camera + self.to_sun
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        strength, exponent = GLOSS[material]
        lit = (normal @ self.to_sun) > 0
        shine = strength * sun * lit * np.maximum((normal * half).sum(1), 0.0) ** exponent
        sent: Float[np.ndarray, "p 3"] = matt[:, None] * np.array(COLOURS[material]) + shine[:, None]
        return self.E * sent


def draw_light(config: DrawConfig, E: Float[np.ndarray, "3"], random: np.random.Generator) -> Light:
    """The sun's place and the sky's share, drawn."""
    azimuth = random.uniform(0, 2 * np.pi)
    elevation = np.radians(random.uniform(*config.sun_elevation_deg))
    flat = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
    return Light(np.array([*flat, np.sin(elevation)]), float(random.uniform(*config.sky)), E)
