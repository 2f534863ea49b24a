"""An op-amp circuit adjusted to a measured gain, unity crossing and phase margin.

Sizes and bias of a design are known; what is not are the channel-length modulation or the load resistance, which decide
the gain, the compensation capacitor, which decides the unity crossing, and the load capacitance, such as that of a
cable, which decides the phase margin. Newton's method on the logarithms of the three finds them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.validation import instance, real_number
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import circuit_figures

_ITERATIONS: Final = 40
_DIFFERENCE: Final = 1e-4
_MOST_CHANGE: Final = 1.0  # of a logarithm in an iteration
_TOLERANCE: Final = 1e-8
_RANGE: Final = 7.0  # of a logarithm: a factor of 1000 either way


def calibrate_circuit(
    circuit: AmplifierCircuit, gain: float, gain_bandwidth: float, phase_margin: float
) -> AmplifierCircuit:
    """Return the circuit whose figures are the measured ones.

    With two stages the load resistance is adjusted to the gain, with one stage lambda; Cc and the load capacitance to
    unity crossing and phase margin.

    Parameters
    ----------
    circuit : AmplifierCircuit
        The design, one circuit.
    gain : float
        Measured open-loop gain [V/V], in [1.01, 1e9].
    gain_bandwidth : float
        Measured unity crossing [Hz], in [1, 1e12].
    phase_margin : float
        Measured phase margin [degrees], in [-85, 179].

    Returns
    -------
    AmplifierCircuit
        The adjusted circuit.

    Raises
    ------
    ValueError
        An argument is not real, not finite or out of range, or no values within a factor of 1000 give these figures:
        then sizes or bias are others, or Rz is.

    Examples
    --------
    The op-amp of the paper with a cable of 100 pF, from its measured figures:

    >>> from posfet_model.amplifier.calibration import calibrate_circuit
    >>> from posfet_model.amplifier.circuit import AmplifierCircuit
    >>> found = calibrate_circuit(AmplifierCircuit.from_design(), 130.16, 1.0084e6, 53.65)
    >>> print(f"{found.load_capacitance * 1e12:.0f} pF")
    100 pF
    """
    circuit = instance("circuit", circuit, AmplifierCircuit)
    if circuit.shape:
        raise ValueError(f"circuit must be a single one, got an array of shape {circuit.shape}")
    wanted = np.array(
        [
            np.log(real_number("gain", gain, 1.01, 1e9)),
            np.log(real_number("gain_bandwidth", gain_bandwidth, 1, 1e12)),
            np.deg2rad(real_number("phase_margin", phase_margin, -85, 179)),
        ]
    )
    adjusted = np.zeros(3)
    for _ in range(_ITERATIONS):
        values = _figures(circuit, adjusted + _DIFFERENCE * np.eye(4, 3, -1))
        missing = wanted - values[0]
        if not np.isfinite(values).all() or np.abs(missing).max() <= _TOLERANCE:
            break
        slopes = (values[1:] - values[0]).T / _DIFFERENCE
        change = np.linalg.lstsq(slopes, missing, rcond=1e-9)[0]
        change *= min(1.0, _MOST_CHANGE / np.abs(change).max())
        adjusted = np.clip(adjusted + change, -_RANGE, _RANGE)
    if not np.abs(missing).max() <= 1e-6:
        raise ValueError(
            f"gain, gain_bandwidth and phase_margin must be reachable by load and compensation of this circuit, got "
            f"{gain:g} ({20 * np.log10(gain):.4g} dB), {gain_bandwidth:g} Hz and {phase_margin:g} degrees"
        )
    return _with(circuit, adjusted)


def _figures(circuit: AmplifierCircuit, adjusted: Array) -> Array:
    """Return ln(gain), ln(unity crossing) and the phase margin [rad] of circuits adjusted by logarithms [k, 3]."""
    found = circuit_figures(_with(circuit, adjusted))
    return np.stack([np.log(found.gain), np.log(found.gain_bandwidth), np.deg2rad(found.phase_margin)], axis=-1)


def _with(circuit: AmplifierCircuit, adjusted: Array) -> AmplifierCircuit:
    gain, speed, load = np.exp(np.moveaxis(adjusted, -1, 0))
    name = "load_resistance" if circuit.stages == 2 else "modulation"
    return replace(
        circuit,
        compensation=circuit.compensation * speed,
        load_capacitance=np.maximum(circuit.load_capacitance, 1e-15) * load,
        **{name: getattr(circuit, name) * gain},
    )
