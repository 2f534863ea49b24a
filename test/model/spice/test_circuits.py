# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The set of circuits and their netlists."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from posfet_model.amplifier.operating_point import CIRCUIT_B
from posfet_model.device.paper import STACK
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import CIRCUITS, Circuit, with_film, with_widths
from posfet_model.spice.netlist import SPICE_OXIDE_PERMITTIVITY, subcircuit
from support.spice_data import small_signal, transient

needs_ngspice = pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")


def values(text: str) -> dict[str, float]:
    """Return the last number of each element of a netlist."""
    return {
        line.split()[0]: float(re.split(r"[ =]", line)[-1]) for line in text.splitlines() if re.match(r"[crvi]", line)
    }


def test_the_set_is_wide() -> None:
    assert len(CIRCUITS) >= 16
    loads = [circuit.bias.load_capacitance for circuit in CIRCUITS.values()]
    assert (min(loads), max(loads)) == (1e-12, 300e-12)
    assert {circuit.stages for circuit in CIRCUITS.values()} == {1, 2}
    assert len({(circuit.stages, circuit.bias, circuit.design) for circuit in CIRCUITS.values()}) == len(CIRCUITS)


@pytest.mark.parametrize("name", CIRCUITS)
def test_a_netlist_has_the_values_of_its_circuit(name: str) -> None:
    circuit, text = CIRCUITS[name], subcircuit(CIRCUITS[name])
    bias, found = circuit.bias, values(text)
    assert found["cc"] == bias.compensation
    assert found["cload"] == bias.load_capacitance
    assert found["rload"] == bias.load_resistance
    assert found["iref"] == bias.reference_current
    assert found.get("rz", 0.0) == (bias.zero_resistor if circuit.stages == 2 else 0.0)
    for size in circuit.design.sizes:
        card = re.search(rf"(?m)^{size.name.lower()} .* w=(\S+) l=(\S+)$", text)
        assert card is not None
        assert (float(card[1]), float(card[2])) == (size.width, size.length)
    film = re.search(r"\.model posfet .* tox=(\S+) lambda=(\S+)\)", text)
    assert film is not None
    assert SPICE_OXIDE_PERMITTIVITY / float(film[1]) == pytest.approx(circuit.design.stack.series, rel=1e-8)
    assert float(film[2]) == bias.modulation


def test_changed_sizes_and_films() -> None:
    design = with_film(5e-6, with_widths(M7=1e-3))
    assert design.size("M7").width == 1e-3
    assert design.size("M8").width == 60e-6
    assert design.stack.film == pytest.approx(STACK.film / 2, rel=1e-12)
    with pytest.raises(ValueError, match="M9"):
        with_widths(M9=1e-3)
    with pytest.raises(ValueError, match="M1 like M2"):
        with_widths(M1=1e-3)


@pytest.mark.parametrize(("name", "stages"), [("", 2), ("a b", 2), ("a", 3), ("a", 0)])
def test_invalid_circuits_are_refused(name: str, stages: int) -> None:
    with pytest.raises(ValueError, match="name" if stages == 2 else "stages"):
        Circuit(name, stages, CIRCUIT_B)


@pytest.mark.spice
@needs_ngspice
@pytest.mark.parametrize(("name", "stored"), [("two_stage", "opamp_b"), ("one_stage", "opamp_c")])
def test_generated_netlists_behave_as_the_shipped_ones(name: str, stored: str) -> None:
    text = subcircuit(CIRCUITS[name])
    now = ngspice.run_follower_ac(text, per_decade=20)
    np.testing.assert_allclose(now.transfer, small_signal(stored, "ac").transfer, rtol=0, atol=2e-4)
    source = ngspice.piecewise_linear([0, 1e-6, 1.01e-6, 6e-6], [0, 0, 1, 1])
    run, before = ngspice.run_follower(text, source, 6e-6, 1e-8), transient(stored, "step")
    np.testing.assert_allclose(np.interp(before.time, run.time, run.v_out), before.v_out, rtol=0, atol=2e-3)


@pytest.mark.spice
@needs_ngspice
def test_a_resistor_of_no_ohms_is_left_out() -> None:
    with_none, with_little = (
        ngspice.run_open_loop_ac(subcircuit(replace(CIRCUITS["two_stage"], bias=replace(CIRCUIT_B, zero_resistor=ohm))))
        for ohm in (0.0, 1e-2)
    )
    np.testing.assert_allclose(with_none.transfer, with_little.transfer, rtol=1e-4)
