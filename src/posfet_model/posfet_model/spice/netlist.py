# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The netlist of a circuit, for ngspice or any SPICE with the level 1 transistor: from the same data as the models."""

from __future__ import annotations

from typing import Final

from posfet_model._lib.validation import instance
from posfet_model.amplifier.operating_point import AmplifierBias, AmplifierDesign
from posfet_model.device.transistor import Plane
from posfet_model.spice.circuits import Circuit

SPICE_OXIDE_PERMITTIVITY: Final = 3.9 * 8.854214871e-12
"""Permittivity of the gate oxide in the level 1 model of SPICE [F/m]."""

_MODELS: Final = {"M1": "posfet", "M2": "posfet", "M3": "pfet", "M4": "pfet", "M5": "nfet", "M6": "nfet", "M8": "nfet"}

_FIRST: Final = {
    "M3": "mirror mirror vdd vdd",
    "M4": "first mirror vdd vdd",
    "M5": "tail bias vss vss",
    "M6": "bias bias vss vss",
}

_NODES: Final = {
    2: {
        "M1": "mirror minus tail tail",
        "M2": "first plus tail tail",
        **_FIRST,
        "M7": "out first vdd vdd",
        "M8": "out bias vss vss",
    },
    1: {
        "M1": "mirror plus tail tail",
        "M2": "first minus tail tail",
        **_FIRST,
        "M7": "vdd first out out",
        "M8": "out bias vss vss",
    },
}
"""Drain, gate, source and bulk of each transistor, by the number of stages."""

_TITLES: Final = {
    2: "Two-stage Miller op-amp with POSFET inputs",
    1: "One stage with POSFET inputs and an n-channel output follower",
}


def subcircuit(circuit: Circuit) -> str:
    """Return the netlist of an op-amp: ``.subckt opamp plus minus out`` with its own supplies and load.

    The gates of M1 and M2 act through film and oxide in series, written as the thickness of an oxide of the same
    capacitance. There are no overlap or junction capacitances; the junctions
    are SPICE's own, of 1e-14 A.

    Parameters
    ----------
    circuit : Circuit
        The circuit.

    Returns
    -------
    str
        The netlist, for `ngspice.run_follower`, or for a deck of your own.

    Raises
    ------
    ValueError
        `circuit` is not a Circuit.

    Examples
    --------
    >>> from posfet_model.spice import circuits, netlist
    >>> text = netlist.subcircuit(circuits.CIRCUITS["one_stage"])
    >>> print(text.splitlines()[2])
    .model posfet nmos (level=1 vto=0.7 uo=850 tox=8.5750262e-07 lambda=0.0248)
    """
    circuit = instance("circuit", circuit, Circuit)
    bias, design = circuit.bias, circuit.design
    return "\n".join(
        [
            f"* {_TITLES[circuit.stages]}: {circuit.name}",
            ".subckt opamp plus minus out",
            *_model_cards(bias, design),
            f"vpos vdd 0 {bias.supply:.9g}",
            f"vneg vss 0 {-bias.supply:.9g}",
            *(
                f"{size.name.lower()} {_NODES[circuit.stages][size.name]} {_model(size.name, circuit.stages)} "
                f"w={size.width:.9g} l={size.length:.9g}"
                for size in design.sizes
            ),
            f"iref vdd bias {bias.reference_current:.9g}",
            *_compensation(circuit.stages, bias),
            f"rload out 0 {bias.load_resistance:.9g}",
            f"cload out 0 {bias.load_capacitance:.9g}",
            ".ends opamp",
        ]
    )


def _compensation(stages: int, bias: AmplifierBias) -> list[str]:
    if stages == 1:
        return [f"cc first 0 {bias.compensation:.9g}"]
    if not bias.zero_resistor:  # SPICE takes 0 ohm for 1 mohm, and warns
        return [f"cc first out {bias.compensation:.9g}"]
    return [f"rz first zero {bias.zero_resistor:.9g}", f"cc zero out {bias.compensation:.9g}"]


def _model(name: str, stages: int) -> str:
    return _MODELS.get(name) or ("pfet" if stages == 2 else "nfet")


def _model_cards(bias: AmplifierBias, design: AmplifierDesign) -> list[str]:
    """Return the cards of the three kinds of transistor; mobilities in cm2/(V s), as SPICE has them."""

    def card(name: str, kind: str, threshold: float, mobility: float, plane: Plane) -> str:
        thickness = SPICE_OXIDE_PERMITTIVITY / design.stack.drive(plane)
        return (
            f".model {name} {kind} (level=1 vto={threshold:.9g} uo={mobility * 1e4:.9g} "
            f"tox={thickness:.9g} lambda={bias.modulation:.9g})"
        )

    return [
        card("posfet", "nmos", bias.threshold + design.pair_threshold_shift, design.electron_mobility, Plane.GATE),
        card("nfet", "nmos", bias.threshold, design.electron_mobility, Plane.OXIDE),
        card("pfet", "pmos", -bias.threshold, design.hole_mobility, Plane.OXIDE),
    ]
