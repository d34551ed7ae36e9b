"""How far a survey's conductors are from the true ones: `python benchmarks/survey_truth.py SURVEY TRUTH`.

SURVEY: the survey.json of a metric scene of known wires; TRUTH: its truth.json.  Each true wire is compared
with the conductor nearest to it, over their common stretch without 0.3 m at either end.
"""

import json
import sys
from pathlib import Path

import numpy as np

from plnerf.survey.catenary import Base


def main(survey: Path, truth: Path) -> None:
    found = json.loads(survey.read_text())["conductors"]
    if not found:
        sys.exit(f"{survey} has no conductors.")
    true = json.loads(truth.read_text())["conductors"]
    print("| wire | sag, true | found | stated sigma | RMSE across | up |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    used = []
    for wire in true:
        off = [apart(one, np.array(wire["polyline"])) for one in found]
        k = int(np.argmin([np.hypot(*one) for one in off]))
        used.append(k)
        across, up = 100 * off[k]
        one = found[k]
        print(f"| {wire['name']} | {wire['sag_m']:.3f} m | {one['sag']:.3f} m | {one['sag_sigma']:.3f} m | "
              f"{across:.1f} cm | {up:.1f} cm |")  # fmt: skip
    print(f"{len(found)} conductors, {len(set(used))} of {len(true)} wires each by one of its own")


def apart(one: dict, line: np.ndarray) -> np.ndarray:
    """Root mean squares across and up, in metres."""
    base = Base(np.array(one["base"]["o"]), np.array(one["base"]["u"]), one["base"]["length"])
    local = base.local(line)
    local = local[np.argsort(local[:, 0])]
    low, high = max(0.0, local[0, 0]), min(base.length_m, local[-1, 0])
    s = np.linspace(low + 0.3, high - 0.3, 400)
    true = np.stack([np.interp(s, local[:, 0], local[:, k]) for k in (1, 2)], 1)
    return np.sqrt(((base.at(np.array(one["q"]), s) - true) ** 2).mean(0))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
