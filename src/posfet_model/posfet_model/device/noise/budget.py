# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""All sources of noise together, and the smallest force that stands out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.types import FloatArray
from posfet_model._lib.validation import common_dtype, real_array, real_number
from posfet_model.device.noise.band import flicker_rms, quantisation_rms, white_rms
from posfet_model.device.noise.density import DENSITY_LIMIT


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseBudget:
    """Noise at the gate in a band, by source; numbers or arrays, which broadcast."""

    bias: FloatArray
    """Noise of the bias resistor [V rms]."""
    thermal: FloatArray
    """Thermal noise of the amplifier's input stage [V rms]."""
    flicker: FloatArray
    """1/f noise of the amplifier [V rms]."""
    sampling: FloatArray
    """kT/C noise of the ADC's sampling capacitor [V rms]."""
    quantisation: FloatArray
    """Quantisation noise of the ADC [V rms]."""
    volts_per_newton: FloatArray
    """Magnitude of the gate shift per force [V/N]."""

    @property
    def sources(self) -> dict[str, FloatArray]:
        """Noise of each source [V rms] by name."""
        return {name: getattr(self, name) for name in ("bias", "thermal", "flicker", "sampling", "quantisation")}

    @property
    def total(self) -> FloatArray:
        """Sum of all sources, as the root of their mean squares [V rms]."""
        squares: FloatArray = sum((np.square(source) for source in self.sources.values()), np.zeros(()))
        return np.sqrt(squares)

    def minimum_force(self, sigmas: float = 3.0) -> FloatArray:
        """Return the smallest detectable force [N]: its gate shift is `sigmas` times the total rms.

        A change of force within the band is meant, since a static force leaks away.

        Parameters
        ----------
        sigmas : float, default 3.0
            Detection threshold in standard deviations [1], in (0, 100].

        Returns
        -------
        ndarray
            Force [N]; inf when force gives no voltage.

        Raises
        ------
        ValueError
            `sigmas` is not real, not finite or out of range.
        """
        noise = real_number("sigmas", sigmas, 1e-3, 100) * np.asarray(self.total)
        with np.errstate(divide="ignore", invalid="ignore"):
            force: FloatArray = np.where(np.equal(self.volts_per_newton, 0), math.inf, noise / self.volts_per_newton)
        return force[()]

    def signal_to_noise(self, force: ArrayLike) -> FloatArray:
        """Return the ratio of a force's gate shift to the total rms [dB].

        Parameters
        ----------
        force : array_like
            Force [N], in [1e-12, 1e9]; the rms value of a vibration, or the height of a step.

        Returns
        -------
        ndarray
            ``20*log10(F*volts_per_newton/total)`` [dB]; -inf when force gives no voltage, inf without noise.

        Raises
        ------
        ValueError
            The force is not real, not finite or out of range.
        """
        newtons = real_array("force", force, 1e-12, 1e9)
        with np.errstate(divide="ignore"):
            ratio: FloatArray = 20 * np.log10(newtons * self.volts_per_newton) - 20 * np.log10(self.total)
        return ratio


def noise_budget(
    bias_rms: ArrayLike,
    thermal_density: ArrayLike,
    flicker_coefficient: ArrayLike,
    lsb: ArrayLike,
    volts_per_newton: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    *,
    gain: ArrayLike = 1.0,
    sampled_rms: ArrayLike = 0.0,
) -> NoiseBudget:
    """Return the noise referred to the gate in a band, by source.

    Parameters
    ----------
    bias_rms : array_like
        Noise of the bias resistor in the band, referred to the gate [V], in [0, 1e6] (`bias_resistor_rms`).
    thermal_density : array_like
        Thermal noise density of the amplifier, referred to the gate [V2/Hz], in [0, 1e6].
    flicker_coefficient : array_like
        K of the 1/f noise, referred to the gate [V2], in [0, 1e6].
    lsb : array_like
        Step of the ADC behind the follower [V], in [0, 1e6]; all of its quantisation noise is assigned to the band.
    volts_per_newton : array_like
        Gate shift per force [V/N], in [0, 1e12].
    low, high : array_like
        Ends of the band [Hz], 1e-12 <= low < high <= 1e15.
    gain : array_like, default 1.0
        Gain of the follower [V/V], in [1e-3, 1e3].
    sampled_rms : array_like, default 0.0
        kT/C noise of the ADC behind the follower [V], in [0, 1e6] (`sampling_rms`).

    Returns
    -------
    NoiseBudget
        Noise of each source [V rms].

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or the shapes do not broadcast.
    """
    follower = real_array("gain", gain, 1e-3, 1e3)
    sampled = real_array("sampled_rms", sampled_rms, 0, 1e6)
    bias, thermal, flicker, sampling, quantisation, sensitivity = common_dtype(
        bias_rms=real_array("bias_rms", bias_rms, 0, 1e6),
        thermal_density=white_rms(real_array("thermal_density", thermal_density, 0, DENSITY_LIMIT), low, high),
        flicker_coefficient=flicker_rms(
            real_array("flicker_coefficient", flicker_coefficient, 0, DENSITY_LIMIT), low, high
        ),
        sampled_rms=sampled / follower,
        lsb=quantisation_rms(lsb) / follower,
        volts_per_newton=real_array("volts_per_newton", volts_per_newton, 0, 1e12),
    )
    return NoiseBudget(
        bias=bias,
        thermal=thermal,
        flicker=flicker,
        sampling=sampling,
        quantisation=quantisation,
        volts_per_newton=sensitivity,
    )
