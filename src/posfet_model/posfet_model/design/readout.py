# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Default values of amplifier, ADC and band of a design, with unit and source; the paper gives none but sizes."""

from __future__ import annotations

from typing import Final

from posfet_model.amplifier.operating_point import CIRCUIT_B, HOLE_MOBILITY
from posfet_model.device.paper import AMPLIFIER_SIZES, Quantity

_FITTED: Final = "circuit B, fitted to 42.3 dB and 1.5 MHz"
_SIZE: Final = {size.name: size for size in AMPLIFIER_SIZES}


def _width(name: str, what: str) -> Quantity:
    size = _SIZE[name]
    return Quantity(f"channel width of {what}", size.width, "m", size.source, size.assumed)


def _length(name: str, what: str) -> Quantity:
    size = _SIZE[name]
    return Quantity(f"channel length of {what}", size.length, "m", size.source)


LOAD_WIDTH: Final = _width("M3", "M3 and M4, the p-channel mirror load")
LOAD_LENGTH: Final = _length("M3", "M3 and M4")
TAIL_WIDTH: Final = _width("M5", "M5, the tail current source")
TAIL_LENGTH: Final = _length("M5", "M5")
MIRROR_WIDTH: Final = _width("M6", "M6, which carries the reference current")
MIRROR_LENGTH: Final = _length("M6", "M6")
OUTPUT_WIDTH: Final = _width("M7", "M7, second stage or output follower")
OUTPUT_LENGTH: Final = _length("M7", "M7")
SINK_WIDTH: Final = _width("M8", "M8, current sink of the output")
SINK_LENGTH: Final = _length("M8", "M8")

HOLES: Final = Quantity(
    "mobility of the p-channel transistors", HOLE_MOBILITY, "m2/(V s)", "a third of the electrons'", True
)
REFERENCE_CURRENT: Final = Quantity("current into M6", CIRCUIT_B.reference_current, "A", _FITTED, True)
SUPPLY: Final = Quantity("positive supply, and magnitude of the negative one", CIRCUIT_B.supply, "V", _FITTED, True)
COMPENSATION: Final = Quantity("compensation capacitor Cc", CIRCUIT_B.compensation, "F", _FITTED, True)
ZERO_RESISTOR: Final = Quantity(
    "Rz in series with Cc; not used with one stage", CIRCUIT_B.zero_resistor, "ohm", _FITTED, True
)
LOAD_CAPACITANCE: Final = Quantity(
    "capacitance from the output to ground, such as a cable", CIRCUIT_B.load_capacitance, "F", _FITTED, True
)
LOAD_RESISTANCE: Final = Quantity(
    "resistance from the output to ground", CIRCUIT_B.load_resistance, "ohm", _FITTED, True
)
MODULATION: Final = Quantity(
    "channel-length modulation lambda of all transistors", CIRCUIT_B.modulation, "1/V", _FITTED, True
)

ADC_BITS: Final = Quantity("resolution of the ADC in bits", 16.0, "1", "usual", True)
ADC_LOW: Final = Quantity("lower end of the ADC's range", -5.0, "V", "the supplies", True)
ADC_HIGH: Final = Quantity("upper end of the ADC's range", 5.0, "V", "the supplies", True)
SAMPLING_CAPACITANCE: Final = Quantity("sampling capacitor of the ADC", 10e-12, "F", "usual", True)
LOW_FREQUENCY: Final = Quantity("lower end of the band in which noise counts", 0.1, "Hz", "slow manipulation", True)
HIGH_FREQUENCY: Final = Quantity("upper end of that band", 1000.0, "Hz", "vibration of slip", True)
SIGNAL_FORCE: Final = Quantity("force to which the signal-to-noise ratio refers", 1.0, "N", "a light grasp", True)
DETECTION_SIGMAS: Final = Quantity(
    "standard deviations of the noise in the smallest detectable force", 3.0, "1", "usual", True
)
THRESHOLD_MISMATCH: Final = Quantity(
    "mismatch A of the threshold, of a pair A/sqrt(W*L)",
    45e-9,
    "V m",
    "1 mV um for each nm of oxide, a usual rule",
    True,
)
GAIN_MISMATCH: Final = Quantity("mismatch A of the relative gain factor", 0.02e-6, "m", "2 % um, usual", True)
