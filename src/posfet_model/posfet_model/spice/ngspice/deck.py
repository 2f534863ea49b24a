# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Decks for ngspice: the circuit as a follower, a source, an analysis and the options of all runs.

A circuit is an op-amp, a subcircuit ``opamp plus minus out`` that contains its own supplies. Two come with the package,
in the folder `netlists`: `opamp_b` (two Miller-compensated stages) and `opamp_c` (one stage and an output follower).
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from posfet_model._lib.validation import real_array

CIRCUITS: Final = ("opamp_b", "opamp_c")
"""Names of the netlists that come with the package."""

FOLLOWER: Final = "xdut in out out opamp"
"""The op-amp as a follower, between the nodes in and out of a deck."""

RELATIVE_TOLERANCE: Final = 1e-5
"""reltol of all runs; with ngspice's default of 1e-3 the error on steps of these circuits is several percent of full
scale."""


def netlist(circuit: str) -> str:
    """Return the text of a netlist of the package.

    Parameters
    ----------
    circuit : str
        One of `CIRCUITS`.

    Returns
    -------
    str
        Text of the netlist.

    Raises
    ------
    ValueError
        There is no netlist of that name.
    """
    if circuit not in CIRCUITS:
        raise ValueError(f"circuit must be one of {', '.join(CIRCUITS)}, got {circuit!r}")
    return (files("posfet_model.spice") / "netlists" / f"{circuit}.cir").read_text(encoding="ascii")


def piecewise_linear(time: ArrayLike, volts: ArrayLike) -> str:
    """Return a piecewise linear ngspice source.

    Parameters
    ----------
    time : array_like
        Times of the points [s], shape [k], k >= 2, starting at 0 and increasing, at most 1e6.
    volts : array_like
        Voltages of the points [V], shape [k], within +-1e3.

    Returns
    -------
    str
        The source, for `run_follower`.

    Raises
    ------
    ValueError
        An argument is not real, not finite, out of range or of another shape, or the times do not increase from 0.
    """
    instants = real_array("time", time, 0, 1e6)
    levels = real_array("volts", volts, -1e3, 1e3)
    if instants.ndim != 1 or instants.shape != levels.shape or instants.size < 2:
        raise ValueError(f"time and volts must be of one shape [k], k >= 2, got {instants.shape} and {levels.shape}")
    if instants[0] != 0 or not (np.diff(instants) > 0).all():
        raise ValueError(
            f"time must rise from 0, got {instants[0]:g} first and steps down to {np.diff(instants).min():g}"
        )
    points = "\n".join(f"+ {t:.12g} {v:.12g}" for t, v in zip(instants, levels, strict=True))
    return f"pwl(\n{points}\n+ )"


def deck_text(
    circuit: str,
    source: str,
    instance: str,
    analysis: str,
    saved: Sequence[str] = ("v(in)", "v(out)"),
    tolerance: float = RELATIVE_TOLERANCE,
) -> str:
    """Return a deck with a source `vin`, the instance `xdut` of the circuit and an analysis; unchecked."""
    options = f".options method=gear reltol={tolerance:g} abstol=1e-14 vntol=1e-9 chgtol=1e-18 trtol=1 gmin=1e-15"
    return "\n".join(["follower", circuit, source, instance, options, f".save {' '.join(saved)}", analysis, ".end", ""])
