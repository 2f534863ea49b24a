# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Noise of the readout: bias resistor, amplifier, 1/f, sampling and quantisation, and the smallest detectable force.

Spectra are one-sided power spectral densities [V2/Hz]. The sources are independent, so densities and mean squares add.
"""

from posfet_model.device.noise.band import bias_resistor_rms, flicker_rms, quantisation_rms, sampling_rms, white_rms
from posfet_model.device.noise.budget import NoiseBudget, noise_budget
from posfet_model.device.noise.density import flicker_density, gate_flicker_coefficient, pair_density, resistor_density
from posfet_model.device.noise.sequence import flicker_sequence

__all__ = [
    "NoiseBudget",
    "bias_resistor_rms",
    "flicker_density",
    "flicker_rms",
    "flicker_sequence",
    "gate_flicker_coefficient",
    "noise_budget",
    "pair_density",
    "quantisation_rms",
    "resistor_density",
    "sampling_rms",
    "white_rms",
]
