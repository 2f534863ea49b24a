"""What makes a simulated board unlike its ideal: each with a default that is assumed, and each can be switched off.

No published figure of a POSFET array could be read for any of these: every default is assumed. Files carry human units,
named in each key (docs/simulation.md has the table); everything in the dataclass is SI. What the sensor file says (gain
and rails of the amplifier, bits, noise and range of the converter, leak, pyroelectric coefficient and thermal time
constant) is the sensor, not its imperfection, and holds with `none()`, too; `OF_THE_SENSOR` can be switched off.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

from posfet_model.config import read_yaml

OF_THE_SENSOR: Final = (
    "pyroelectric", "amplifier_gain", "amplifier_offset", "amplifier_rails", "adc_noise", "quantisation",
)  # fmt: skip
"""What the sensor file gives and `none()` keeps; each can be switched off all the same."""
NONE: Final = "none"
DEFAULT: Final = "default"


@dataclass(frozen=True)
class Imperfections:
    """Imperfections of one board; 0 or False switches each one off. Spreads are standard deviations over the taxels."""

    gain_spread: float
    """Relative spread of the gain, for force and temperature alike [1]."""
    area_spread: float
    """Relative spread of the area: force per area goes with its inverse, pyroelectric charge per area stays [1]."""
    offset_spread: float
    """Spread of the amplifiers' input offset [V]."""
    leak_spread: float
    """Relative spread (log-normal) of the leak's time constant [1]."""
    crosstalk: float
    """Share of a taxel's gate shift seen by each of its four neighbours [1]."""
    dead_share: float
    """Probability that a taxel does not respond; its offset and noise stay [1]."""
    stuck_share: float
    """Probability that a taxel shows one code for ever [1]."""
    noisy_share: float
    """Probability that a taxel has `noisy_factor` times the white noise [1]."""
    noisy_factor: float
    """White noise of a noisy taxel over that of the others [1]."""
    hysteresis: float
    """Width of the film's loop between no and the greatest force, as a share of the greatest force [1]."""
    pyroelectric: bool
    """Whether temperature gives charge, as the sensor file says."""
    amplifier_gain: bool
    """Whether the follower's gain is that of the sensor file's open loop; else 1."""
    amplifier_offset: bool
    """Whether the amplifiers have the offset that the sensor file gives."""
    amplifier_rails: bool
    """Whether the output ends at the rails that the sensor file gives; else only the converter's ends clip it."""
    amplifier_pole: bool
    """Whether the follower lags behind its input, by the time constant that the sensor file gives."""
    slew_rate: float
    """Steepest output of the amplifier [V/s]; 0: without limit."""
    thermal_noise: float
    """Thermal noise at the amplifier's input [V/sqrt(Hz)], folded from its whole band into the samples."""
    flicker_noise: float
    """1/f noise at the amplifier's input [V/sqrt(Hz)] at 1 Hz."""
    hum_amplitude: float
    """Mains hum at the gate [V]; spread by 20 % over the taxels."""
    hum_frequency: float
    """Frequency of the mains [Hz]."""
    adc_noise: bool
    """Whether the converter has the noise that the sensor file gives."""
    quantisation: bool
    """Whether it rounds to the bits that the sensor file gives; else to the 16 bits of a count."""
    clock_drift: float
    """By how much the board's clock is slow [1]: its scans come this much later."""
    clock_jitter: float
    """Standard deviation of the moment of a scan [s], cut at 4 of them and at a tenth of the interval."""
    dropped_share: float
    """Probability that a scan's frames are lost [1]; on the wire, that a frame is."""
    torn_share: float
    """Probability that a scan is torn [1]; on the wire, that a frame arrives cut short."""
    repeated_share: float
    """Probability that a scan comes twice [1]; on the wire, that a frame does."""
    resets_per_hour: float
    """How often the board resets, at random times [1/h]."""
    reset_time: float
    """How long a board is silent after a reset [s]."""

    @classmethod
    def none(cls) -> Imperfections:
        """Return the ideal board: what the sensor file says, and nothing else."""
        off: dict[str, Any] = {field.name: False if field.type == "bool" else 0.0 for field in fields(cls)}
        return cls(**{**off, **dict.fromkeys(OF_THE_SENSOR, True), "noisy_factor": 1.0, "hum_frequency": 50.0})

    @classmethod
    def default(cls) -> Imperfections:
        """Return a plausible board; every value is assumed."""
        return cls(**{key.attribute: key.default for key in KEYS})

    def without_noise(self) -> Imperfections:
        """Return the same board without anything random from scan to scan; mains hum is off, too."""
        return replace(
            self,
            thermal_noise=0.0,
            flicker_noise=0.0,
            hum_amplitude=0.0,
            adc_noise=False,
            clock_jitter=0.0,
            dropped_share=0.0,
            torn_share=0.0,
            repeated_share=0.0,
            resets_per_hour=0.0,
        )


@dataclass(frozen=True)
class Key:
    """One key of a file of imperfections."""

    section: str
    name: str
    attribute: str
    default: Any
    """Default in SI; assumed."""
    scale: float = 1.0
    """SI over the unit of the file."""
    low: float = 0.0
    high: float = 0.0
    """Range in the unit of the file; of no meaning for true or false."""


KEYS: Final = (
    Key("taxels", "gain_spread_percent", "gain_spread", 0.05, 1e-2, 0, 30),
    Key("taxels", "area_spread_percent", "area_spread", 0.03, 1e-2, 0, 30),
    Key("taxels", "offset_spread_mV", "offset_spread", 5e-3, 1e-3, 0, 1000),
    Key("taxels", "leak_spread_percent", "leak_spread", 0.10, 1e-2, 0, 100),
    Key("taxels", "crosstalk_percent", "crosstalk", 0.02, 1e-2, 0, 20),
    Key("taxels", "dead_percent", "dead_share", 0.01, 1e-2, 0, 100),
    Key("taxels", "stuck_percent", "stuck_share", 0.01, 1e-2, 0, 100),
    Key("taxels", "noisy_percent", "noisy_share", 0.02, 1e-2, 0, 100),
    Key("taxels", "noisy_factor", "noisy_factor", 5.0, 1.0, 1, 1000),
    Key("film", "hysteresis_percent", "hysteresis", 0.01, 1e-2, 0, 20),
    Key("film", "pyroelectric", "pyroelectric", True),
    Key("amplifier", "gain", "amplifier_gain", True),
    Key("amplifier", "offset", "amplifier_offset", True),
    Key("amplifier", "rails", "amplifier_rails", True),
    Key("amplifier", "pole", "amplifier_pole", True),
    Key("amplifier", "slew_rate_V_per_us", "slew_rate", 1e6, 1e6, 0, 1e6),
    Key("amplifier", "thermal_noise_nV_per_sqrtHz", "thermal_noise", 20e-9, 1e-9, 0, 1e6),
    Key("amplifier", "flicker_noise_uV_per_sqrtHz", "flicker_noise", 10e-6, 1e-6, 0, 1e6),
    Key("mains", "amplitude_mV", "hum_amplitude", 0.5e-3, 1e-3, 0, 1000),
    Key("mains", "frequency_Hz", "hum_frequency", 50.0, 1.0, 0, 1000),
    Key("converter", "noise", "adc_noise", True),
    Key("converter", "quantisation", "quantisation", True),
    Key("clock", "drift_ppm", "clock_drift", 20e-6, 1e-6, -1000, 1000),
    Key("clock", "jitter_us", "clock_jitter", 0.2e-6, 1e-6, 0, 1000),
    # CAN sends again what was disturbed: only an overrun loses a frame now and then.
    Key("line", "dropped_percent", "dropped_share", 1e-6, 1e-2, 0, 100),
    Key("line", "torn_percent", "torn_share", 1e-6, 1e-2, 0, 100),
    Key("line", "repeated_percent", "repeated_share", 1e-6, 1e-2, 0, 100),
    Key("board", "resets_per_hour", "resets_per_hour", 1.0, 1.0, 0, 3600),
    Key("board", "reset_time_s", "reset_time", 0.3, 1.0, 0, 60),
)
"""Every key of a file; the order is that of docs/simulation.md."""


def load_imperfections(name: str | Path) -> Imperfections:
    """Return what `name` means: 'none', 'default', or the path of a YAML file.

    A file says what it starts from (`base: none` or `base: default`) and then what differs. Raises ConfigError, one
    line naming file, key, allowed range and value, for an unknown or repeated key, a wrong type, NaN, a value out of
    range, or a file that cannot be read.
    """
    if str(name) in (NONE, DEFAULT):
        return _base(str(name))
    top = read_yaml(name)
    base = _base(top.text("base", (NONE, DEFAULT)))
    changes: dict[str, Any] = {}
    for title in dict.fromkeys(key.section for key in KEYS):
        if title not in top:
            continue
        section = top.section(title)
        for key in (key for key in KEYS if key.section == title):
            present = getattr(base, key.attribute)
            if isinstance(key.default, bool):
                changes[key.attribute] = section.flag(key.name, default=present)
            elif key.name in section:
                changes[key.attribute] = section.number(key.name, key.low, key.high) * key.scale
        section.end()
    top.end()
    return replace(base, **changes)


def _base(name: str) -> Imperfections:
    return Imperfections.none() if name == NONE else Imperfections.default()
