# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The circuits that follower models are compared with in ngspice: sizes, bias, compensation and load as data.

A circuit is one of two topologies (`two_stage`, `one_stage`) with a bias and sizes. `netlist.subcircuit` writes it for
SPICE. The set covers 36 to 60 dB, 0.3 to 10 MHz, loads of 1 to 300 pF, with good margins, ringing, and unstable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from posfet_model._lib.validation import instance, whole_number
from posfet_model.amplifier.one_stage import CIRCUIT_C
from posfet_model.amplifier.operating_point import CIRCUIT_B, TABLE_II, AmplifierBias, AmplifierDesign
from posfet_model.device.constants import VACUUM_PERMITTIVITY
from posfet_model.device.paper import FILM_PERMITTIVITY
from posfet_model.device.transistor import Stack


@dataclass(frozen=True)
class Circuit:
    """An op-amp with its output fed back to the inverting input, and what loads it."""

    name: str
    """Short name, letters, digits and underscores."""
    stages: int
    """2: Miller op-amp of `two_stage`; 1: op-amp with an output follower of `one_stage`."""
    bias: AmplifierBias
    """Bias, compensation and load."""
    design: AmplifierDesign = TABLE_II
    """Sizes of M1 to M8, film and process."""

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isascii() and self.name.replace("_", "").isalnum()):
            raise ValueError(f"name must consist of letters, digits and underscores, got {self.name!r:.60}")
        whole_number("stages", self.stages, 1, 2)
        instance("bias", self.bias, AmplifierBias)
        instance("design", self.design, AmplifierDesign)


def with_widths(design: AmplifierDesign = TABLE_II, **widths: float) -> AmplifierDesign:
    """Return a design with other widths of some transistors.

    Parameters
    ----------
    design : AmplifierDesign, default TABLE_II
        Sizes and process.
    **widths : float
        Width [m] by name of the transistor, such as ``M1=1e-3``.

    Returns
    -------
    AmplifierDesign
        The design.

    Raises
    ------
    ValueError
        A transistor is unknown, or M1 and M2, or M3 and M4, would differ.
    """
    unknown = sorted(set(widths) - {size.name for size in design.sizes})
    if unknown:
        raise ValueError(f"widths must be of M1 to M8, got {', '.join(unknown)}")
    sizes = tuple(replace(size, width=widths.get(size.name, size.width)) for size in design.sizes)
    return replace(design, sizes=sizes)


def with_film(thickness: float, design: AmplifierDesign = TABLE_II) -> AmplifierDesign:
    """Return a design with a film of another thickness [m] and the paper's permittivity."""
    film = FILM_PERMITTIVITY.value * VACUUM_PERMITTIVITY / thickness
    return replace(design, stack=Stack(oxide=design.stack.oxide, film=film))


def _two_stages(name: str, design: AmplifierDesign = TABLE_II, **bias: float) -> Circuit:
    return Circuit(name, 2, replace(CIRCUIT_B, **bias), design)


def _one_stage(name: str, design: AmplifierDesign = TABLE_II, **bias: float) -> Circuit:
    return Circuit(name, 1, replace(CIRCUIT_C, **bias), design)


CIRCUITS: Final = {
    circuit.name: circuit
    for circuit in (
        _two_stages("two_stage"),
        _two_stages("two_stage_100pf", load_capacitance=100e-12),
        _two_stages("two_stage_300pf", load_capacitance=300e-12),
        _two_stages("two_stage_no_zero_resistor", zero_resistor=0.0),
        _two_stages("two_stage_half_cc", compensation=23.1e-12),
        _two_stages("two_stage_narrow_pair_50pf", with_widths(M1=1e-3, M2=1e-3), load_capacitance=50e-12),
        _two_stages(
            "two_stage_wide_output_50ua_30pf",
            with_widths(M7=480e-6, M8=120e-6),
            reference_current=50e-6,
            load_capacitance=30e-12,
        ),
        _two_stages("two_stage_thin_film_unstable", with_film(1e-6), load_resistance=100e3, zero_resistor=500.0),
        _two_stages(
            "two_stage_59db_300khz",
            reference_current=50e-6,
            load_resistance=100e3,
            compensation=150e-12,
            zero_resistor=3000.0,
        ),
        _two_stages("two_stage_10mhz_1pf", compensation=6e-12, load_capacitance=1e-12),
        _two_stages("two_stage_small_rz_30pf", load_resistance=50e3, zero_resistor=500.0, load_capacitance=30e-12),
        _two_stages(
            "two_stage_no_rz_unstable",
            with_film(1.5e-6),
            load_resistance=50e3,
            compensation=20e-12,
            zero_resistor=0.0,
            load_capacitance=50e-12,
        ),
        _one_stage("one_stage"),
        _one_stage("one_stage_100pf", load_capacitance=100e-12),
        _one_stage("one_stage_half_cc_30pf", compensation=16.5e-12, load_capacitance=30e-12),
        _one_stage("one_stage_narrow_pair_25ua", with_widths(M1=800e-6, M2=800e-6), reference_current=25e-6),
        _one_stage("one_stage_36db", modulation=0.054, load_capacitance=3e-12),
        _one_stage("one_stage_60db_1pf", modulation=0.0045, reference_current=50e-6, load_capacitance=1e-12),
        _one_stage("one_stage_10mhz", compensation=4e-12, load_capacitance=1e-12),
        _one_stage("one_stage_300khz_300pf", compensation=120e-12, load_capacitance=300e-12),
    )
}
"""The set, by name. `two_stage` and `one_stage` are circuits B and C of docs/device.md."""
