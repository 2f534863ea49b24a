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
