"""How far the attachments of surveys are from the true ends of conductors:
`python benchmarks/attachments.py SURVEY TRUTH [SURVEY TRUTH ...]`.

SURVEY is a survey's folder, TRUTH the truth.json of the scene that it is of.  An attachment is compared with
the nearest end of a true conductor that runs the same way from there; one without such an end within 1 m
belongs to no wire.  Prints for each survey the attachments, the open ends, the largest differences along the
wire, across it and upwards, and every attachment that is off by more than 10 cm, with the half width of its
95 % interval along the wire.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.files import SURVEY_FILE, read_survey
from plnerf.line.survey import Survey

NEAR_M, ASKED_M = 1.0, 0.10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("pairs", nargs="+", type=Path, metavar="SURVEY TRUTH")
    options = parser.parse_args()
    if len(options.pairs) % 2:
        parser.error("Give a truth.json after each survey.")
    for folder, truth in zip(options.pairs[::2], options.pairs[1::2], strict=True):
        survey = read_survey(folder / SURVEY_FILE)
        compare(folder.name, survey, json.loads(truth.read_text(encoding="utf-8"))["conductors"])


def compare(name: str, survey: Survey, conductors: list[dict]) -> None:
    """Prints what is off by how much."""
    places = np.array([one[end] for one in conductors for end in "ab"])
    inwards = np.array([sign * np.array(one["direction"]) for one in conductors for sign in (1.0, -1.0)])
    labels = [f"{one['name']}, end {end}" for one in conductors for end in "ab"]
    off, far, strangers, still_open = [], [], 0, 0
    for wire in survey.wires:
        middle = survey.frame.to_world(wire.points(np.array([wire.base.length_m / 2])))[0]
        for end in wire.ends:
            if not isinstance(end, Attached):
                still_open += 1
                continue
            at = survey.frame.to_world(end.point[None])[0]
            apart = np.linalg.norm(places - at, axis=1)
            apart[((middle - places)[:, :2] * inwards).sum(1) <= 0] = np.inf
            k = int(apart.argmin())
            if not apart[k] <= NEAR_M:
                strangers += 1
                continue
            gap, u = at - places[k], inwards[k]
            off.append([gap[:2] @ u, gap[:2] @ [-u[1], u[0]], gap[2]])
            if np.abs(off[-1]).max() > ASKED_M:
                far.append((labels[k], off[-1], TWO_SIDED_95 * end.sigma_m))
    worst = np.abs(np.array(off).reshape(-1, 3)).max(0, initial=0.0)
    print(
        f"{name}: {len(off)} attachments, {still_open} open ends, {strangers} of wires that are none; at "
        f"most {worst[0]:.3f} m along, {worst[1]:.3f} across, {worst[2]:.3f} up; {len(far)} beyond 10 cm"
    )
    for label, (along, across, up), half in far:
        print(f"  {label}: {along:+.3f} along (+- {half:.2f}), {across:+.3f} across, {up:+.3f} up")


if __name__ == "__main__":
    main()
