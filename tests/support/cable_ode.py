"""A hanging elastic cable by integrating its equations: a truth for states that shares no code with them.

Letters: s the length of the unstressed, cold cable; H horizontal and V vertical tension; w weight per
unstressed length, q horizontal wind and i ice per the same; the stretched element is

    d(x, y, z)/ds = (1 + T/EA + alpha t) (tension / T),      dV/ds = w + i,      dQ/ds = q

so that, other than a catenary's, the weight of a stretched metre is less.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve


class Cable:
    """One span between fixed points, D apart and with h of rise."""

    def __init__(self, D: float, h: float, w: float, ea: float, alpha: float) -> None:
        self.D, self.h, self.w, self.ea, self.alpha = D, h, w, ea, alpha

    def curve(self, start: np.ndarray, length: float, t: float, load: tuple[float, float]) -> np.ndarray:
        """x, y, z along the cable from its first end, where its tension is `start`."""
        q, ice = load

        def along(_: float, state: np.ndarray) -> np.ndarray:
            tension = state[3:]
            T = np.linalg.norm(tension)
            stretch = 1 + T / self.ea + self.alpha * t
            # What hangs below an element is carried by the next one: tension grows upwards.
            return np.array([*(stretch * tension / T), 0.0, -q, self.w + ice])

        found = solve_ivp(
            along, (0.0, length), np.array([0.0, 0.0, 0.0, *start]), rtol=1e-9, atol=1e-9,
            t_eval=np.linspace(0.0, length, 801),
        )  # fmt: skip
        return found.y[:3]

    def hang(self, length: float, t: float, load: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """The curve of a cable of this unstressed length: x, y, z."""
        end = np.array([self.D, 0.0, self.h])
        weight = self.w + load[1]
        H = weight * self.D**2 / (8 * 0.03 * self.D)
        guess = np.array([H, load[0] * self.D / 2, -weight * self.D / 2 + H * self.h / self.D])
        start, _, good, why = fsolve(
            lambda one: self.curve(one, length, t, load)[:, -1] - end, guess, full_output=True, xtol=1e-11
        )
        assert good == 1, why
        return self.curve(start, length, t, load)

    def length_of_sag(self, sag: float, t: float) -> float:
        """The unstressed length that hangs with this sag at a temperature, without load."""
        chord = float(np.hypot(self.D, self.h))

        def off(length: float) -> float:
            return self.sag(self.hang(length, t)) - sag

        return float(brentq(off, 0.9985 * chord, 1.02 * chord, xtol=1e-9))

    @staticmethod
    def sag(curve: np.ndarray) -> float:
        """Greatest vertical drop below the chord."""
        x, _, z = curve
        drop = z[-1] / x[-1] * x - z
        k = int(drop.argmax())
        a, b, _ = np.polyfit(x[k - 2 : k + 3] - x[k], drop[k - 2 : k + 3], 2)
        return float(drop[k] - b**2 / (4 * a))
