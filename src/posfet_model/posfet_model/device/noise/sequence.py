# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Records of random noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import instance, real_number, whole_number
from posfet_model.device.noise.density import DENSITY_LIMIT


def flicker_sequence(
    coefficient: float, rate: float, samples: int, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return a record of Gaussian 1/f noise [V] with the density K/f.

    Parameters
    ----------
    coefficient : float
        K [V2], in [0, 1e6].
    rate : float
        Sampling rate [Hz], in [1e-9, 1e12].
    samples : int
        Length of the record, in [2, 2**26].
    generator : numpy.random.Generator
        Source of random numbers; the same seed reproduces the record.

    Returns
    -------
    ndarray
        Noise [V], shape [samples].

    Raises
    ------
    ValueError
        An argument is out of range, or the generator is not a Generator.

    Notes
    -----
    Generated in the frequency domain: at each frequency m*rate/samples, 0 < m <= samples/2, the expected periodogram is
    exactly K/f (spectrum error 0; a single periodogram scatters by 100 %, as for any noise). There is no power below
    rate/samples, so the mean is 0, and the record is periodic: make it longer than the part that is used.
    """
    volts2 = real_number("coefficient", coefficient, 0, DENSITY_LIMIT)
    rate = real_number("rate", rate, 1e-9, 1e12)
    samples = whole_number("samples", samples, 2, 2**26)
    generator = instance("generator", generator, np.random.Generator)
    order = np.arange(1, samples // 2 + 1)
    # Mean square of each complex amplitude: density*rate*samples/2, halved once more for real and imaginary part. The
    # bin at rate/2, present for an even number of samples, is real and represents half a bin's width.
    scale = np.sqrt(volts2 / (order * rate / samples) * rate * samples / 4)
    spectrum = np.zeros(samples // 2 + 1, np.complex128)
    spectrum[1:] = scale * (generator.standard_normal(order.size) + 1j * generator.standard_normal(order.size))
    if samples % 2 == 0:
        spectrum[-1] = spectrum[-1].real * math.sqrt(2)
    return np.fft.irfft(spectrum, samples)
