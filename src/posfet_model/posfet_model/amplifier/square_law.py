# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Square-law transistors of either polarity as SPICE level 1 has them: currents, conductances, gate capacitances.

    Id = beta*(Vov - v/2)*v*(1 + lambda*Vds),    Vov = Vgs - Vth,    v = min(Vov, Vds)

source and drain exchanged where Vds < 0. The gate capacitance of an area C = W*L*Cox splits by Meyer: 2/3*C to the
source in saturation, half and half towards Vds = 0, to the bulk in cut-off. Sources: H. Shichman, D. A. Hodges, IEEE J.
Solid-State Circuits 3 (1968) 285, doi:10.1109/JSSC.1968.1049902; J. E. Meyer, RCA Review 32 (1971) 42. Bodies are tied
to sources, so the bulk's part counts to the source, and the junction from body to drain conducts where Vds is below
some -0.5 V, as on the side of the pair that a steep edge switches off. Functions here are internal and unchecked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask

SURFACE_POTENTIAL: Final = 0.6
"""PHI of SPICE level 1 [V]: width below threshold over which the gate's capacitance moves from channel to bulk."""

SATURATION_CURRENT: Final = 1e-14
"""IS of SPICE level 1 [A]: of the junction from the body, which is the source, to the drain."""

THERMAL_VOLTAGE: Final = 0.0258649
"""k*T/q at 27 degC, the temperature of SPICE [V]."""

_STEEPEST: Final = 0.75
"""Forward voltage of a junction beyond which its current goes on as a straight line [V]."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Transistors at a bias point, all fields of the broadcast shape."""

    current: Array
    """Current into the drain, of the p-channel sign where the transistor is one [A]."""
    transconductance: Array
    """dId/dVgs [S]."""
    output_conductance: Array
    """dId/dVds [S]."""


def linearise(
    polarity: Array, beta: Array, threshold: Array, modulation: Array, gate: Array, drain: Array
) -> Linearised:
    """Return currents and conductances; unchecked.

    Parameters
    ----------
    polarity : ndarray
        1 for n-channel, -1 for p-channel transistors.
    beta : ndarray
        Gain factor mu*Cox*W/L [A/V2].
    threshold, modulation : ndarray
        Magnitude of the threshold [V], lambda [1/V].
    gate, drain : ndarray
        Gate-source and drain-source voltage [V].

    Returns
    -------
    Linearised
        Currents and conductances.
    """
    vgs, vds = polarity * gate, polarity * drain
    swapped = vds < 0
    overdrive = np.maximum(np.where(swapped, vgs - vds, vgs) - threshold, 0.0)
    across = np.abs(vds)
    channel = np.minimum(overdrive, across)
    factor = beta * (1 + modulation * across)
    core = (overdrive - 0.5 * channel) * channel
    current = factor * core
    gm = factor * channel
    gds = factor * (overdrive - channel) + beta * modulation * core
    if not swapped.any():
        return Linearised(polarity * current, gm, gds)
    sign = np.where(swapped, -polarity, polarity)
    through, slope = _junction(np.where(swapped, across, 0.0))
    return Linearised(
        current=sign * current - polarity * through,
        transconductance=np.where(swapped, -gm, gm),
        output_conductance=np.where(swapped, gm + gds, gds) + slope,
    )


def _junction(forward: Array) -> tuple[Array, Array]:
    """Return the current from the body to the drain [A] at a forward voltage [V], 0 at least, and its slope [S]."""
    share = np.minimum(forward, _STEEPEST) / THERMAL_VOLTAGE
    slope = np.where(forward > 0, SATURATION_CURRENT / THERMAL_VOLTAGE * np.exp(share), 0.0)
    current = SATURATION_CURRENT * np.expm1(share) + slope * np.maximum(forward - _STEEPEST, 0.0)
    return current, slope


def gate_capacitances(polarity: Array, area: Array, threshold: Array, gate: Array, drain: Array) -> tuple[Array, Array]:
    """Return the capacitances from gate to source, with the bulk's part, and from gate to drain [F]; unchecked.

    Parameters
    ----------
    polarity : ndarray
        1 for n-channel, -1 for p-channel transistors.
    area : ndarray
        W*L*Cox [F].
    threshold : ndarray
        Magnitude of the threshold [V].
    gate, drain : ndarray
        Gate-source and drain-source voltage [V].

    Returns
    -------
    tuple of ndarray
        Gate-source and gate-drain capacitance [F].
    """
    vgs, vds = polarity * gate, polarity * drain
    swapped = vds < 0
    overdrive = np.where(swapped, vgs - vds, vgs) - threshold
    across = np.abs(vds)
    channel = np.maximum(overdrive, 1e-12)
    triode = (across < channel) & (overdrive > 0)
    source: Array | float = 2 / 3
    far: Array | float = 0.0
    if triode.any():
        rest = np.where(triode, 2 * channel - across, 1.0)
        source = np.where(triode, 2 / 3 * (1 - ((channel - across) / rest) ** 2), 2 / 3)
        far = np.where(triode, 2 / 3 * (1 - (channel / rest) ** 2), 0.0)
    # Below threshold: bulk from 0 to 1 over PHI, source from 2/3 to 0 over half of it.
    depth = np.minimum(np.maximum(-overdrive / SURFACE_POTENTIAL, 0.0), 1.0)
    to_bulk = depth
    source = np.where(overdrive > 0, source, np.maximum(2 / 3 - 4 / 3 * depth, 0.0))
    near_source = np.where(swapped, far, source) + to_bulk
    near_drain = np.where(swapped, source, far)
    return area * near_source, area * near_drain


def saturated(polarity: Array, threshold: Array, gate: Array, drain: Array) -> Mask:
    """Return which transistors conduct in saturation; unchecked.

    Parameters
    ----------
    polarity : ndarray
        1 for n-channel, -1 for p-channel transistors.
    threshold : ndarray
        Magnitude of the threshold [V].
    gate, drain : ndarray
        Gate-source and drain-source voltage [V].

    Returns
    -------
    ndarray
        Mask.
    """
    overdrive = polarity * gate - threshold
    return np.asarray((overdrive > 0) & (polarity * drain >= overdrive))
