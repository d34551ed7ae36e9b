"""Gaussians in space with colours that depend on the direction of view: what is exported of a field."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from plnerf.export.splat_sh import degree_of, sh_rotation


@dataclass(frozen=True, eq=False)
class Splats:
    """n Gaussians with covariance R diag(scale^2) R^T; float32, but positions float64."""

    xyz: Float[np.ndarray, "n 3"]
    scale: Float[np.ndarray, "n 3"]
    """Standard deviations along their own axes, in the unit of `xyz`."""
    rotation: Float[np.ndarray, "n 4"]
    """Unit quaternions w, x, y, z of R."""
    opacity: Float[np.ndarray, " n"]
    """In (0, 1)."""
    sh: Float[np.ndarray, "n K 3"]
    """Coefficients of red, green and blue (`splat_sh.py`)."""
    drawn: int = 0
    """How many of the last ones are wires, drawn for display."""

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def degree(self) -> int:
        """Of the spherical harmonics."""
        return degree_of(self.sh.shape[1])

    def moved(self, R: Float[np.ndarray, "3 3"], shift: Float[np.ndarray, "3"]) -> "Splats":
        """The same Gaussians in other axes: x_new = R x + shift."""
        w_last = (Rotation.from_matrix(R) * Rotation.from_quat(self.rotation[:, [1, 2, 3, 0]])).as_quat()
        M = sh_rotation(R, self.degree)
        return replace(
            self,
            xyz=self.xyz @ R.T + shift,
            rotation=w_last[:, [3, 0, 1, 2]].astype(np.float32),
            sh=np.einsum("kj,njc->nkc", M, self.sh).astype(np.float32),
        )

    def chosen(self, index: np.ndarray | slice) -> "Splats":
        """Some of them, in the order of `index`; none of these count as drawn."""
        some = (self.xyz[index], self.scale[index], self.rotation[index], self.opacity[index], self.sh[index])
        return Splats(*some)

    def followed_by(self, wires: "Splats") -> "Splats":
        """These, and after them wires that are drawn for display."""
        names = ("xyz", "scale", "rotation", "opacity", "sh")
        both = {name: np.concatenate([getattr(self, name), getattr(wires, name)]) for name in names}
        return Splats(**both, drawn=len(wires))
