"""A line as plain values: its wires, its supports, and the chain of structures and spans that it is.

Lengths in metres (_m), angles in degrees (_deg).  "Along" a line runs from its first structure to its last, 0
in the middle of its main span; "across" it is positive to the left.
"""

from dataclasses import dataclass
from typing import Literal

from plnerf.errors import ConfigError

MOST_TURN_DEG = 60.0  # of a line at one structure
SUSPENDED_TURN_DEG = 5.0  # by which a line may turn where strings merely hang


def require_positive(**values: float | int) -> None:
    """Refuse the first value that is not greater than 0."""
    for name, value in values.items():
        if not value > 0:
            raise ConfigError(f"synth: {name} must be greater than 0, got {value}. Give a positive value.")


@dataclass(frozen=True)
class WireConfig:
    """One phase, shield wire or neutral; the same on both supports."""

    name: str
    kind: Literal["phase", "shield", "neutral"]
    across_m: float
    height_m: float
    """of the clamp above the support's foot"""
    sag_m: float
    diameter_m: float
    bundle: int = 1
    """sub-conductors side by side, each a conductor of its own"""
    bundle_gap_m: float = 0.4
    insulator: Literal["string", "vee", "pin", "spool", "none", "tension"] = "string"
    """one string or two in a V hang from the cross-arm, a pin stands on it, a spool sits at a pole's side;
    of tension strings one pulls into each span: strings and Vs become these at strain structures"""
    swing_deg: float = 0.0
    """by how far wind turns the plane of its curve to the left of the line; insulators stay as they are"""
    colour: tuple[float, float, float] = (1.0, 1.0, 1.01)
    """factors on the linear reflectance of weathered aluminium, about 0.25"""

    def __post_init__(self) -> None:
        require_positive(**{
            f"{self.name}: sag_m": self.sag_m,
            f"{self.name}: diameter_m": self.diameter_m,
            f"{self.name}: height_m": self.height_m,
            f"{self.name}: bundle": self.bundle,
            f"{self.name}: bundle_gap_m": self.bundle_gap_m,
        })
        if not -60 <= self.swing_deg <= 60:
            raise ConfigError(f"synth: {self.name}: swing_deg must be in -60 to 60, got {self.swing_deg}.")


@dataclass(frozen=True)
class SupportConfig:
    """The towers or poles of a line."""

    kind: Literal["lattice", "pole"] = "lattice"
    height_m: float = 12.7
    """top above the foot"""
    foot_m: float = 2.3
    """width of a lattice tower at its foot, diameter of a pole there"""
    waist_m: float = 0.72
    """width of a lattice tower at its lowest arm, diameter of a pole at its top"""
    shoulder_m: float = 0.6
    """width of a lattice tower above its highest arm"""
    string_length_m: float = 0.95
    """insulator string, from cross-arm down to the clamp"""

    def __post_init__(self) -> None:
        require_positive(
            height_m=self.height_m,
            foot_m=self.foot_m,
            waist_m=self.waist_m,
            shoulder_m=self.shoulder_m,
            string_length_m=self.string_length_m,
        )


@dataclass(frozen=True)
class StructureConfig:
    """What one tower or pole does to its line."""

    kind: Literal["suspension", "strain", "terminal"] = "suspension"
    """suspension: wires pass through and strings hang; strain: wires end on either side in tension strings,
    and jumpers join them; terminal: the line ends"""
    turn_deg: float = 0.0
    """by how far the line turns to the left here"""
    raised_m: float = 0.0
    """by how much it is higher than the line's other supports, wires and all"""

    def __post_init__(self) -> None:
        if not abs(self.turn_deg) <= MOST_TURN_DEG:
            raise ConfigError(
                f"synth: a line turns by {MOST_TURN_DEG:g} degrees at most at one structure, got turn_deg = "
                f"{self.turn_deg}. Spread the turn over several structures."
            )
        if self.kind == "suspension" and abs(self.turn_deg) > SUSPENDED_TURN_DEG:
            raise ConfigError(
                f"synth: at a suspension structure a line turns by {SUSPENDED_TURN_DEG:g} degrees at most, "
                f"got turn_deg = {self.turn_deg}. Make it a strain structure."
            )


@dataclass(frozen=True)
class LineConfig:
    """A chain of structures and the spans between them."""

    wires: tuple[WireConfig, ...]
    """on every structure; sags are those of the main span"""
    support: SupportConfig
    azimuth_deg: float
    """direction of the main span from +x towards +y"""
    lengths_m: tuple[float, ...]
    """horizontal distances from structure to structure, in order"""
    name: str = ""
    """begins the names of its wires and structures; of a scene's first line empty"""
    main: int = 0
    """index of the main span"""
    middle_m: tuple[float, float] = (0.0, 0.0)
    """x and y of the middle of the main span"""
    structures: tuple[StructureConfig, ...] = ()
    """one more than spans; empty: all are suspension structures in a straight line"""
    slack: tuple[tuple[float, ...], ...] = ()
    """for each span one factor on the sags of all wires, or one for each wire; empty: 1.  A sag is its wire's
    sag_m, times this, times the squared ratio of the span's length to the main one's: equal tension"""
    spacer_step_m: float = 15.0
    """between the spacers of a bundle, at most"""

    def __post_init__(self) -> None:
        require_positive(spacer_step_m=self.spacer_step_m)
        _check_wires(self.wires, self.support)
        for length in self.lengths_m:
            require_positive(span_length_m=length)
        if not 0 <= self.main < len(self.lengths_m):
            raise ConfigError(
                f"synth: the main span's index must be below {len(self.lengths_m)}, got {self.main}."
            )
        if self.structures and len(self.structures) != len(self.lengths_m) + 1:
            raise ConfigError(
                f"synth: {len(self.lengths_m)} spans hang on {len(self.lengths_m) + 1} structures, got "
                f"{len(self.structures)}. Name them all, or none."
            )
        if any(one.kind == "terminal" for one in self.structures[1:-1]):
            raise ConfigError("synth: only the first and the last structure of a line can be terminal.")
        if self.structures and (self.structures[0].turn_deg or self.structures[-1].turn_deg):
            raise ConfigError(
                "synth: a line does not turn at its first or last structure: set turn_deg to 0."
            )
        allowed = {1, len(self.wires)}
        if self.slack and (
            len(self.slack) != len(self.lengths_m) or any(len(one) not in allowed for one in self.slack)
        ):
            raise ConfigError(
                f"synth: slack must name one factor, or one for each of {len(self.wires)} wires, for each of "
                f"{len(self.lengths_m)} spans, got {self.slack}."
            )

    def structure(self, number: int) -> StructureConfig:
        """The structure of this index."""
        return self.structures[number] if self.structures else StructureConfig()

    def sag_m(self, span: int, wire: int) -> float:
        """Of the wire of this index in the span of this index."""
        sag = self.wires[wire].sag_m
        if span != self.main:
            sag *= (self.lengths_m[span] / self.lengths_m[self.main]) ** 2
        if self.slack:
            factors = self.slack[span]
            sag *= factors[wire if len(factors) > 1 else 0]
        return sag

    def wire(self, name: str) -> WireConfig:
        """The wire of this name."""
        return wire_named(self.wires, name)


def wire_named(wires: tuple[WireConfig, ...], name: str) -> WireConfig:
    """The wire of this name.  Raises ConfigError without one."""
    for wire in wires:
        if wire.name == name:
            return wire
    raise ConfigError(f"synth: there is no wire {name!r}; name one of {[w.name for w in wires]}.")


def _check_wires(wires: tuple[WireConfig, ...], support: SupportConfig) -> None:
    """Refuse wires without names of their own, and wires that their support is too low for."""
    if not wires:
        raise ConfigError("synth: wires must name at least one wire, got none.")
    names = [wire.name for wire in wires]
    if len(set(names)) < len(names):
        raise ConfigError(f"synth: every wire needs a name of its own, got {', '.join(names)}.")
    for wire in wires:
        top = wire.height_m + (support.string_length_m if wire.insulator in ("string", "vee") else 0.0)
        if top > support.height_m:
            raise ConfigError(
                f"synth: {wire.name} needs its support at {top:.2f} m above the foot (clamp height + "
                f"insulator) but the support's height_m is {support.height_m}. "
                "Raise the support or lower the wire."
            )
