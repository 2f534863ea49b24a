# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mismatch of the op-amp's transistors, and what it does to common-mode rejection.

M. J. M. Pelgrom et al., IEEE J. Solid-State Circuits 24 (1989) 1433, doi:10.1109/JSSC.1989.572629: the standard
deviation of the difference of two transistors is A/sqrt(W*L), for the threshold and for the relative gain factor.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from posfet_model._lib.types import Array, FloatArray
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.design.amplifier_figures import AmplifierFigures
from posfet_model.design.design_fields import DesignFields


def deviations(design: DesignFields, part: str) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations of differences: threshold [V], relative gain factor [1]; unchecked.

    Those of two transistors of the same size; one of them deviates from its nominal value by 1/sqrt(2) of that.

    Parameters
    ----------
    design : DesignFields
        One design or arrays.
    part : str
        Whose size counts: "gate" of M1, M2, "load" of M3, M4, "tail" of M5, "mirror" of M6, "sink" of M8. The threshold
        is at the oxide.
    """
    root = np.sqrt(np.multiply(getattr(design, f"{part}_width"), getattr(design, f"{part}_length")))
    return design.threshold_mismatch / root, design.gain_mismatch / root


def mismatched(circuit: AmplifierCircuit, pair: tuple[Array, Array], load: tuple[Array, Array]) -> AmplifierCircuit:
    """Return a circuit whose input pair and load differ, by half either way; unchecked.

    Parameters
    ----------
    circuit : AmplifierCircuit
        One circuit, or arrays of them.
    pair, load : tuple of ndarray
        Differences of M1, M2 and of M3, M4: threshold [V], as the circuit counts it, and relative gain factor [1].
    """
    shape = np.broadcast_shapes(circuit.shape, *(np.shape(one) for one in (*pair, *load)))
    threshold = np.array(np.broadcast_to(circuit.threshold, (*shape, 8)))
    beta = np.array(np.broadcast_to(circuit.beta, (*shape, 8)))
    for first, (volts, gain) in ((0, pair), (2, load)):
        for index, half in ((first, 0.5), (first + 1, -0.5)):
            threshold[..., index] += half * volts
            beta[..., index] *= np.maximum(1 + half * gain, 0.1)
    return dataclasses.replace(circuit, threshold=threshold, beta=beta)


def hand_common_mode_rejection(design: DesignFields, amplifier: AmplifierFigures) -> FloatArray:
    """Return the CMRR with mismatch of one standard deviation of each pair [V/V], by a hand formula; unchecked.

    An input moves the tail's current by gds5 and the pair's drain voltage, and with them the pair's overdrive Vov, to
    which the offsets by gain factors are proportional; so is that by the thresholds of M3 and M4, at a given current:
    ``1/CMRR^2 = 1/CMRR_s^2 + (Vov/4*(l5 + l1))^2*(s(b1)^2 + s(b3)^2) + (l1/2*gm3/gm1*s(Vth3))^2`` with
    ``l = gds/I`` and the rejection CMRR_s of the matched circuit.

    Parameters
    ----------
    design : DesignFields
        One design or arrays.
    amplifier : AmplifierFigures
        Figures of its op-amp.
    """
    (_, pair), (threshold, load) = deviations(design, "gate"), deviations(design, "load")
    both = amplifier.tail_modulation + amplifier.pair_modulation
    ratio = amplifier.load_transconductance / amplifier.input_transconductance
    by_gain = 0.25 * amplifier.overdrive * both * np.hypot(pair, load)
    by_threshold = 0.5 * amplifier.pair_modulation * ratio * threshold
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1 / np.sqrt(1 / amplifier.common_mode_rejection**2 + by_gain**2 + by_threshold**2)
