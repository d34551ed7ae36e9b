"""Whether every planted encroachment of a 400 m span is listed, and none that is not there:
`python benchmarks/encroachments.py OUT [--seed 1]`.

A LiDAR flight is simulated over trees that grow in, fall in and stand where wind blows the conductors to,
over houses and a crossing line, all planted too near by exact wires and bodies; and over as many trees,
bushes and houses that are clear of everything.  The cloud has no classes.  It is surveyed with a matrix of
three rules, a storm and a rate of growth; `OUT` holds the cloud, the survey and its report.

planted      kind, how near it truly comes in that way, and the record that lists it, with its ways
invented     records that belong to nothing planted
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from plnerf.line.encroachments import Encroachment, Way
from plnerf.line.line import Line, Span, Structure
from plnerf.line.states import State
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.states import compute_states
from plnerf.pipeline import write_survey
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.lidar.point_cloud import read_cloud
from plnerf.survey.run import survey_cloud
from plnerf.synth.build import stand
from plnerf.synth.config import PlantsConfig, SpanConfig, TerrainConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.houses import roof, walls
from plnerf.synth.lidar import CLOUD, _write_cloud
from plnerf.synth.lidar_bodies import sampled, still_bodies
from plnerf.synth.lidar_config import Boom, LidarScene, ScanConfig, WindConfig
from plnerf.synth.lidar_scan import scan
from plnerf.synth.line_config import LineConfig, SupportConfig, WireConfig
from plnerf.synth.site import House, Plant, Site

SPAN_M, PLANTS_M, HOUSES_M, LINES_M = 400.0, 3.0, 9.0, 5.0
GROWTH_M, YEARS = 0.6, 3.0
CROSSING_AT_M = 135.0
TEMPERATURE_C = 15.0
RULES = """
name = "planted"
source = "this benchmark"
date = "2026"
classes_kv = [110]
""" + "".join(
    f'[[row]]\nobject = "{name}"\ndirection = "radial"\ndistance = {distance}\nread_in = "here"\n'
    for name, distance in (("vegetation", PLANTS_M), ("building", HOUSES_M), ("line", LINES_M))
)
STORM = '[[state]]\nname = "storm"\ntemperature_c = 15\nwind_pa = 500\n'


@dataclass(frozen=True)
class Planted:
    """One encroachment and how near it comes in its way."""

    way: Way
    body: Plant | House
    distance_m: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in (("rules.toml", RULES), ("storm.toml", STORM)):
        (options.out / name).write_text(text)
    mechanics = MechanicsConfig(conductor=Path("acsr-drake"), states=options.out / "storm.toml")
    scene = flight(options.seed)
    site, planted = planted_site(scene, mechanics)
    rng = np.random.default_rng([options.seed, 29])
    still, _ = still_bodies(site, scene, rng)
    _write_cloud(options.out / CLOUD, *scan(site, scene, still, rng))
    config = SurveyConfig(
        rules=RulesConfig(options.out / "rules.toml", 110.0), mechanics=mechanics,
        temperature_c=TEMPERATURE_C,
        encroachments=EncroachmentConfig(growth_m=GROWTH_M, growth_years=YEARS),
    )  # fmt: skip
    survey = survey_cloud(read_cloud(options.out / CLOUD), config)
    print(f"{write_survey(survey, options.out / 'survey')}")
    score(survey, planted, len(site.lines[0].config.wires) - 1, len(site.lines[1].config.wires))


def flight(seed: int) -> LidarScene:
    """Three phases in a plane and a shield wire over a 400 m span, crossed by a line of two wires."""
    sag = SPAN_M**2 / (8 * 1500.0)
    places = zip("ABC", (-7.0, 0.0, 7.0), strict=True)
    phases = [WireConfig(f"phase {name}", "phase", y, 32.0, sag, 0.028) for name, y in places]
    shield = WireConfig("shield", "shield", 0.0, 40.0, 0.7 * sag, 0.015, insulator="none")
    low = tuple(
        WireConfig(f"wire {k}", "phase", y, 22.2, 1.5, 0.015, insulator="none")
        for k, y in ((1, -1.5), (2, 1.5))
    )
    crossing = LineConfig(
        low, SupportConfig("pole", 22.8, 0.4, 0.3), 92.0, (110.0,), "low line", 0, (CROSSING_AT_M, 0.0)
    )
    span = SpanConfig(
        seed=seed, span_length_m=SPAN_M, line_azimuth_deg=0.0, wires=(*phases, shield),
        support=SupportConfig("lattice", 41.0, 7.0, 2.0, 1.6, 2.0),
        terrain=TerrainConfig(waves=1.0, hills=0.0, track="none"),
        plants=PlantsConfig(trees=0, bushes=0, background=0), before_m=(300.0,), after_m=(320.0,),
        others=(crossing,),
    )  # fmt: skip
    scan_config = ScanConfig((-30.0, 30.0), 250.0, 12.0, 0.08, 0.02, 0.02, 0.01, corridor_m=48.0)
    boom = Boom(-300.0, 0.0, 0.0, 5.0, 1.0)  # outside of what is scanned
    none = ((0.0,) * 4,) * 4
    return LidarScene("encroachments", span, boom, WindConfig((0.0, 0.0), (0.0, 0.0)), scan_config, none)


def planted_site(scene: LidarScene, mechanics: MechanicsConfig) -> tuple[Site, list[Planted]]:
    """The span with what is planted, and of that what is too near.  Raises ValueError where a tree of no
    height comes as near as it should."""
    site = stand(scene.span)
    rng = np.random.default_rng([scene.span.seed, 31])
    still = [wire for wire in site.lines[0].spans[1].wires if wire.kind == "phase"]
    swung = in_storm(site, mechanics)
    still_axes, all_axes = axes(still), np.concatenate([axes(still), axes(swung)])
    rest, every = cKDTree(still_axes), cKDTree(all_axes)

    def leaves(plant: Plant) -> np.ndarray:
        return plant_meshes(plant)[1].vertices[::12]  # a corner of each third leaf

    def apart(tree: cKDTree) -> Callable[[Plant], float]:
        return lambda plant: float(tree.query(leaves(plant))[0].min())

    def fall(plant: Plant) -> float:
        foot = np.array(plant.foot)
        reach = np.linalg.norm(leaves(plant) - foot, axis=1).max()
        return float(every.query(foot)[0] - reach)

    def grown(
        along: float, across: float, kind: str, nearness: Callable[[Plant], float], to_m: float
    ) -> Plant:
        """The tree of such a height that it comes so near."""
        seed, radius = int(rng.integers(2**31)), float(rng.uniform(1.6, 2.4))
        low, high = 3.0, 42.0
        foot = site.ground.point(*site.at(along, across))

        def of(height: float) -> Plant:
            return Plant(kind, foot, radius, height, seed)  # type: ignore[arg-type]

        if not nearness(of(low)) > to_m > nearness(of(high)):
            raise ValueError(f"no tree at {along:.0f}, {across:.0f} comes to {to_m:.1f} m")
        while high - low > 0.1:
            middle = (low + high) / 2
            low, high = (middle, high) if nearness(of(middle)) > to_m else (low, middle)
        return of(low)

    stations = np.linspace(-150, 60, 10)
    planted = []
    for k, along in enumerate(stations):
        kind = ("tree", "conifer")[k % 2]
        side = (-1.0, 1.0)[k % 2]
        plant = grown(along, float(rng.uniform(-0.8, 0.8)), "tree", apart(every), 3.95)
        planted.append(Planted("grow-in", plant, apart(every)(plant)))
        blown = -84.0 + 16.0 * k  # where wires swing far
        swing_m = 0.66 * SPAN_M**2 / (8 * 1500.0) * (1 - (2 * blown / SPAN_M) ** 2)
        across = side * (7.0 + swing_m + float(rng.uniform(0.0, 0.8)))
        plant = grown(blown, across, kind, apart(every), 1.2)
        planted.append(Planted("blow-out", plant, apart(every)(plant)))
        plant = grown(along + 5, side * float(rng.uniform(27.0, 33.0)), "conifer", fall, 0.5)
        planted.append(Planted("fall-in", plant, fall(plant)))
    sides = zip(stations, (1.0, -1.0) * 5, strict=True)
    clear = [
        Plant("tree", site.ground.point(*site.at(along - 5, -side * 38.0)), 2.0, 9.0, k)
        for k, (along, side) in enumerate(sides)
    ] + [
        Plant("bush", site.ground.point(*site.at(along + 4, 3.5)), 1.0, 1.6, 100 + k)
        for k, along in enumerate(stations)
    ]
    houses = []
    for k, (along, across) in enumerate(((-178.0, -6.0), (-172.0, 12.0), (80.0, -9.0), (88.0, 8.0))):
        foot = site.ground.point(*site.at(along, across))
        height = float(rest.query(np.array(foot))[0]) - HOUSES_M + 2.0
        houses.append(House(f"house {k}", foot, 20.0 * k, 10.0, 8.0, height - 2.5, height, 5 + k))
    low_houses = [
        House("shed 1", site.ground.point(*site.at(-175.0, 40.0)), 10.0, 8.0, 6.0, 3.0, 5.0, 1),
        House("shed 2", site.ground.point(*site.at(84.0, -41.0)), 50.0, 8.0, 6.0, 3.0, 5.0, 2),
    ]
    plants = tuple(one.body for one in planted if isinstance(one.body, Plant))
    site = replace(site, plants=(*plants, *clear), houses=(*houses, *low_houses))
    for one in houses:
        body = np.concatenate([sampled(mesh, rng) for mesh in (walls(one), roof(one))])
        planted.append(Planted("as surveyed", one, float(rest.query(body)[0].min())))
    return site, planted


def in_storm(site: Site, mechanics: MechanicsConfig) -> list[Wire]:
    """The exact phases of the main span in both states of the storm."""
    line = site.lines[0]
    structures = tuple(
        Structure(one.id, np.array(one.foot), one.height_m, 0.0, "given", "suspension") for one in line.towers
    )
    spans = tuple(
        Span(k, (first.id, last.id), one.wires)
        for k, one in enumerate(line.spans, 1)
        for first, last in [one.towers]
    )
    found, _ = compute_states([Line(1, structures, spans)], TEMPERATURE_C, mechanics)
    assert found is not None

    def of(state: State, wire: Wire) -> Wire:
        one = state.of(wire.id)
        assert one is not None
        return one.of(wire)

    phases = [wire for wire in line.spans[1].wires if wire.kind == "phase"]
    return [of(state, wire) for state in found.states for wire in phases]


def axes(wires: list[Wire]) -> np.ndarray:
    """Points every 5 cm on wires."""
    return np.concatenate([wire.polyline(0.05) for wire in wires])


def score(survey: Survey, planted: list[Planted], phases: int, crossing: int) -> None:
    """Prints what was listed of what was planted."""
    found = survey.encroachments
    records = list(found.records) if found is not None else []
    for line in survey.lines:
        print(f"line {line.id}: {len(line.spans)} spans, wires {[(one.id, one.kind) for one in line.wires]}")
    left = {one.id for one in records}
    counts: dict[str, int] = {}
    wrong_way = 0
    for one in planted:
        foot = survey.frame.from_world(np.array([one.body.foot]))[0]
        mine = [record for record in records if record.object != "line" and holds(record, foot[:2])]
        name = "building" if isinstance(one.body, House) else one.way
        listed = "NOT LISTED" if not mine else ", ".join(
            f"{record.id} (priority {record.priority}: {', '.join(record.ways)}; "
            f"{record.first.distance.value:.2f} +- {record.first.distance.half_95:.2f} m)" for record in mine
        )  # fmt: skip
        print(f"  {name:10s} {one.distance_m:6.2f} m  {listed}")
        counts[name] = counts.get(name, 0) + bool(mine)
        wrong_way += bool(mine) and not any(one.way in record.ways for record in mine)
        if mine:
            left.discard(mine[0].id)
    pairs = [record for record in records if record.object == "line"]
    counts["crossing"] = len({(one.wire, one.other_wire) for one in pairs[: phases * crossing]})
    left -= {one.id for one in pairs[: phases * crossing]}
    for record in records:
        if record.id in left:
            print(
                f"  INVENTED {record.id}: {record.object} at {record.highest.round(1)}, {record.ways}, "
                f"{len(record.outline)} corners"
            )
    total = len(planted) + phases * crossing
    print(f"listed {sum(counts.values())} of {total}: {counts}")
    print(f"not in their way {wrong_way}, invented {len(left)}")
    if found is not None:
        print("not examined:", *found.not_examined)


def holds(record: Encroachment, at: np.ndarray) -> bool:
    """Whether a place lies within a record's outline, or 1 m beside it."""
    corners = record.outline
    edges = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([edges[:, 1], -edges[:, 0]], 1) / np.maximum(np.hypot(*edges.T), 1e-9)[:, None]
    return bool((((at - corners) * normal).sum(1) <= 1.0).all()) and math.isfinite(at[0])


if __name__ == "__main__":
    main()
