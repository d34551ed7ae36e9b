"""What decides the states of a survey."""

from dataclasses import dataclass
from pathlib import Path

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class MechanicsConfig:
    """The conductors, and the states that are computed of them.

    Raises ConfigError for a file that is missing or no file of its kind.
    """

    conductor: Path | None = None
    """Conductor of the phases: a TOML file, or the name of a bundled one; None: no states are computed."""
    shield_conductor: Path | None = None
    """Conductor of the shield wires, likewise."""
    states: Path | None = None
    """A TOML file of states, or the name of a bundled one; None: 50, 75 and 100 degrees Celsius. A
    comparison of surveys reads its strain = [...] alone, the structures that end a tension section."""
    temperature_sigma_c: float = 3.0
    """Standard deviation of the conductors' temperature at the survey, where that is given."""

    def __post_init__(self) -> None:
        if not 0 <= self.temperature_sigma_c <= 50:
            raise ConfigError(
                "The standard deviation of the conductors' temperature must be 0 to 50 degrees, got "
                f"{self.temperature_sigma_c}."
            )
        if (self.conductor, self.shield_conductor, self.states) == (None, None, None):
            return
        from plnerf.mechanics.conductor import load_conductor  # brings NumPy
        from plnerf.mechanics.loads import load_states

        for path in (self.conductor, self.shield_conductor):
            if path is not None:
                load_conductor(path)
        if self.states is not None:
            load_states(self.states)
            if self.conductor is None and self.shield_conductor is None:
                raise ConfigError(
                    f"The states of {self.states} depend on the conductor, but none is given. Give "
                    "--conductor."
                )
