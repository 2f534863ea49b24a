# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sensor error model of a simulated board: non-idealities, each with an assumed default, that can be switched off.

No published figure of a POSFET array was found for any of these: every default is assumed. Files use the units in their
keys (docs/simulation.md has the table); the dataclass is in SI. Properties from the sensor file (gain and rails of the
amplifier, bits, noise and range of the ADC, charge leakage, pyroelectric coefficient and thermal time constant) belong
to the sensor, not to its error model, and hold with `none()`, too; `SENSOR_PROPERTIES` can be switched off.

The option, launch argument and ROS parameter `imperfections` selects the error model. The effects of film and cover are
in `posfet_sim.device.film_effects`, those of the readout board in `posfet_sim.device.board_effects`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from posfet_model.config import read_yaml
from posfet_sim.defaults import DEFAULT
from posfet_sim.device.board_effects import BOARD_KEYS, BoardEffects
from posfet_sim.device.error_model_key import Key, read_keys
from posfet_sim.device.film_effects import FILM_KEYS, FilmEffects

SENSOR_PROPERTIES: Final = (
    "pyroelectric", "amplifier_gain", "amplifier_offset", "amplifier_rails", "adc_noise", "quantisation",
)  # fmt: skip
"""Properties from the sensor file that `none()` keeps; each can be switched off."""
NONE: Final = "none"
"""Name of the ideal board."""
IDEAL, MODERATE, HARD = "ideal", "moderate", "hard"
REALISM: Final = (IDEAL, MODERATE, HARD)
"""Sizes of the effects of film, cover and readout board."""
DEFAULT_REALISM: Final = IDEAL
"""Size of these effects on the default board."""


@dataclass(frozen=True)
class ErrorModel:
    """Non-idealities of one board; 0 or False switches each one off.

    Spreads are standard deviations over the taxels.
    """

    gain_spread: float
    """Relative spread of the gain, for force and temperature alike [1]."""
    area_spread: float
    """Relative spread of the area [1]: scales force per area by its inverse, not the pyroelectric charge per area."""
    offset_spread: float
    """Spread of the amplifiers' input offset [V]."""
    leak_spread: float
    """Relative spread (log-normal) of the leakage time constant [1]."""
    crosstalk: float
    """Fraction of the gate shift of a taxel that couples to each of its four neighbours [1]."""
    dead_probability: float
    """Probability that a taxel does not respond; its offset and noise stay [1]."""
    stuck_probability: float
    """Probability that a taxel is stuck at one code [1]."""
    noisy_probability: float
    """Probability that a taxel has `noisy_factor` times the white noise [1]."""
    noisy_factor: float
    """White noise of a noisy taxel relative to the others [1]."""
    hysteresis: float
    """Width of the hysteresis loop of the film between no force and full scale, relative to full scale [1]."""
    pyroelectric: bool
    """Whether temperature generates charge, as in the sensor file."""
    amplifier_gain: bool
    """Whether the follower has the gain of the open loop in the sensor file; else 1."""
    amplifier_offset: bool
    """Whether the amplifiers have the offset in the sensor file."""
    amplifier_rails: bool
    """Whether the output clips at the rails in the sensor file; else only the ADC clips."""
    amplifier_pole: bool
    """Whether the follower has the pole in the sensor file."""
    slew_rate: float
    """Slew rate of the amplifier [V/s]; 0: no limit."""
    thermal_noise: float
    """Thermal noise at the input of the amplifier [V/sqrt(Hz)], folded from its whole band into the samples."""
    flicker_noise: float
    """1/f noise at the input of the amplifier at 1 Hz [V/sqrt(Hz)]."""
    hum_amplitude: float
    """Amplitude of the mains hum at the gate [V]; spread by 20 % over the taxels."""
    hum_frequency: float
    """Mains frequency [Hz]."""
    adc_noise: bool
    """Whether the ADC has the noise in the sensor file."""
    quantisation: bool
    """Whether the ADC rounds to the bits in the sensor file; else to the 16 bits of a count."""
    clock_drift: float
    """Relative error of the clock of the board [1]: positive when it is slow."""
    clock_jitter: float
    """Standard deviation of the sampling jitter [s], limited to 4 of them and to a tenth of the interval."""
    drop_probability: float
    """Probability that a scan is lost [1]; over CAN, that a frame is."""
    truncation_probability: float
    """Probability that a scan is incomplete [1]; over CAN, that a frame is truncated."""
    duplication_probability: float
    """Probability that a scan is duplicated [1]; over CAN, that a frame is."""
    resets_per_hour: float
    """Rate of board resets, at random times [1/h]."""
    reset_time: float
    """Silence of the board after a reset [s]."""
    film: FilmEffects = field(default_factory=FilmEffects.ideal)
    """Effects of film and cover that an ideal film has not."""
    board: BoardEffects = field(default_factory=BoardEffects.ideal)
    """Further effects of the readout board; all off by default."""

    @classmethod
    def none(cls) -> ErrorModel:
        """Return the ideal board: the properties in the sensor file only."""
        off: dict[str, Any] = {key.attribute: False if isinstance(key.default, bool) else 0.0 for key in KEYS}
        return cls(**{**off, **dict.fromkeys(SENSOR_PROPERTIES, True), "noisy_factor": 1.0, "hum_frequency": 50.0})

    @classmethod
    def default(cls) -> ErrorModel:
        """Return a plausible board; every value is assumed."""
        return cls(**{key.attribute: key.default for key in KEYS}).with_realism(DEFAULT_REALISM)

    def with_realism(self, size: str) -> ErrorModel:
        """Return the same board with the effects of film, cover and readout board of one size.

        Mains hum, sampling jitter and lost scans belong to them; 'ideal' leaves these three as they are. Every value
        is assumed.

        Parameters
        ----------
        size : str
            One of `REALISM`.
        """
        if size == IDEAL:
            return replace(self, film=FilmEffects.ideal(), board=BoardEffects.ideal())
        film, board, hum = {
            MODERATE: (FilmEffects.moderate(), BoardEffects.moderate(), 0.5e-3),
            HARD: (FilmEffects.hard(), BoardEffects.hard(), 5e-3),
        }[size]
        return replace(self, film=film, board=board, hum_amplitude=hum, clock_jitter=5e-6, drop_probability=1e-3)

    def without_noise(self) -> ErrorModel:
        """Return the same board without anything random from scan to scan, and without mains hum."""
        return replace(
            self,
            thermal_noise=0.0,
            flicker_noise=0.0,
            hum_amplitude=0.0,
            adc_noise=False,
            clock_jitter=0.0,
            drop_probability=0.0,
            truncation_probability=0.0,
            duplication_probability=0.0,
            resets_per_hour=0.0,
            board=self.board.without_noise(),
        )


KEYS: Final = (
    Key("taxels", "gain_spread_percent", "gain_spread", 0.05, 1e-2, 0, 30),
    Key("taxels", "area_spread_percent", "area_spread", 0.03, 1e-2, 0, 30),
    Key("taxels", "offset_spread_mV", "offset_spread", 5e-3, 1e-3, 0, 1000),
    Key("taxels", "leak_spread_percent", "leak_spread", 0.10, 1e-2, 0, 100),
    Key("taxels", "crosstalk_percent", "crosstalk", 0.02, 1e-2, 0, 20),
    Key("taxels", "dead_percent", "dead_probability", 0.01, 1e-2, 0, 100),
    Key("taxels", "stuck_percent", "stuck_probability", 0.01, 1e-2, 0, 100),
    Key("taxels", "noisy_percent", "noisy_probability", 0.02, 1e-2, 0, 100),
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
    Key("adc", "noise", "adc_noise", True),
    Key("adc", "quantisation", "quantisation", True),
    Key("clock", "drift_ppm", "clock_drift", 20e-6, 1e-6, -1000, 1000),
    Key("clock", "jitter_us", "clock_jitter", 0.2e-6, 1e-6, 0, 1000),
    # CAN retransmits disturbed frames: only an overrun loses one.
    Key("link", "dropped_percent", "drop_probability", 1e-6, 1e-2, 0, 100),
    Key("link", "truncated_percent", "truncation_probability", 1e-6, 1e-2, 0, 100),
    Key("link", "duplicated_percent", "duplication_probability", 1e-6, 1e-2, 0, 100),
    Key("board", "resets_per_hour", "resets_per_hour", 1.0, 1.0, 0, 3600),
    Key("board", "reset_time_s", "reset_time", 0.3, 1.0, 0, 60),
)
"""Every key of a file, in the order of docs/simulation.md."""


def load_error_model(name: str | Path) -> ErrorModel:
    """Return the error model 'none', 'default', 'moderate' or 'hard', or that of a YAML file.

    'moderate' and 'hard' are the default with effects of film, cover and readout board of that size. A file names its
    base (`base: none` or `base: default`), may name the size of these effects (`realism: ideal`, `moderate` or `hard`),
    and then the differences.

    Parameters
    ----------
    name : str or Path
        'none', 'default', 'moderate', 'hard', or the path of a file.

    Returns
    -------
    ErrorModel
        The error model, in SI units.

    Raises
    ------
    ConfigError
        The file cannot be read, or a key is unknown, duplicate, of a wrong type, NaN or out of range. The message is
        one line naming file, key, allowed range and value.
    """
    if str(name) in (NONE, DEFAULT):
        return _base(str(name))
    if str(name) in (MODERATE, HARD):
        return ErrorModel.default().with_realism(str(name))
    top = read_yaml(name)
    base = _base(top.text("base", (NONE, DEFAULT)))
    changes: dict[str, Any] = {}
    film_changes: dict[str, Any] = {}
    board_changes: dict[str, Any] = {}
    for title in dict.fromkeys(key.section for key in (*KEYS, *FILM_KEYS, *BOARD_KEYS)):
        if title not in top:
            continue
        section = top.section(title)
        changes |= read_keys(section, [key for key in KEYS if key.section == title])
        film_changes |= read_keys(section, [key for key in FILM_KEYS if key.section == title])
        board_changes |= read_keys(section, [key for key in BOARD_KEYS if key.section == title])
        section.end()
    if "realism" in top:
        base = base.with_realism(top.text("realism", REALISM))
    top.end()
    film, board = replace(base.film, **film_changes), replace(base.board, **board_changes)
    return replace(base, **changes, film=film, board=board)


def _base(name: str) -> ErrorModel:
    return ErrorModel.none() if name == NONE else ErrorModel.default()
