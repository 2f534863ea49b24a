# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Each misprint against physics independent of the package: the corrected form holds, the printed one does not."""

import math
import shutil

import numpy as np
import pytest

from posfet_model.device import as_printed, charge, film, mechanics, paper, transistor
from posfet_model.device.transistor import Plane
from posfet_model.spice import ngspice

SILICON = (paper.SILICON_MODULUS.value, paper.SILICON_POISSON_RATIO.value)


def test_eq_1_an_unstressed_film_is_a_capacitor() -> None:
    field, permittivity = 16e6, paper.FILM_PERMITTIVITY.value
    plate_charge = permittivity * 8.8541878188e-12 * field  # capacitor without piezoelectricity
    assert charge.electric_displacement(0.0, field, -38e-12, permittivity) == pytest.approx(plate_charge, abs=1e-15)
    assert as_printed.electric_displacement(0.0, -38e-12, permittivity) == 0
    # At zero field a stress gives d33*T3 alone; the printed form adds a stress in place of a field.
    assert charge.electric_displacement(-1e6, 0.0, -38e-12, permittivity) == pytest.approx(3.8e-5, abs=1e-19)
    assert as_printed.electric_displacement(-1e6, -38e-12, permittivity) < 0


def test_eq_3_the_branch_gives_the_remnant_polarisation_at_zero_field() -> None:
    coercive, remnant, saturation = 160e5, 0.02, 0.05

    def left(steepness: float) -> float:
        return saturation * math.tanh(coercive / (2 * steepness))

    assert left(film.branch_steepness(coercive, remnant, saturation)) == pytest.approx(remnant, abs=1e-16)
    assert math.isnan(as_printed.branch_steepness(coercive, 0.05, 0.02))


def test_eq_6_and_7_no_oxide_withstands_the_whole_polarisation() -> None:
    breakdown = 1e9  # V/m: thermal oxide breaks at 8 to 12 MV/cm
    switched, thickness = paper.FILM.switched_polarisation, paper.OXIDE_THICKNESS.value
    assert -as_printed.threshold_shift(switched, paper.STACK) / thickness > 2 * breakdown
    fraction = transistor.uncompensated_fraction(-1.0, switched, paper.STACK, Plane.OXIDE)
    assert 0 < fraction < 0.02
    assert 1.0 / thickness < breakdown


def test_eq_6_to_10_charge_and_current_by_gauss() -> None:
    """A sheet of charge between film and oxide, gate and channel at fixed potential: current by the channel charge."""
    stack, sheet, overdrive = paper.STACK, 3.8e-5, 1.0
    aspect = paper.CHANNEL_WIDTH.value / paper.CHANNEL_LENGTH.value
    # The sheet has the same voltage across both capacitors: sheet = (Cox + Cpvdf)*V.
    node = np.linalg.solve([[stack.oxide + stack.film]], [sheet])[0]
    channel = stack.oxide * node  # additional channel charge [C/m2]
    exact = paper.MOBILITY.value * aspect * overdrive * channel
    beta = paper.channel_gain_factor(Plane.GATE)
    right = -beta * overdrive * transistor.threshold_shift(sheet, stack, Plane.GATE, 1.0)
    assert right == pytest.approx(exact, rel=1e-12)
    printed = as_printed.signal_current(sheet, overdrive, paper.MOBILITY.value, aspect, stack)
    assert exact / printed == pytest.approx(stack.oxide / stack.film, rel=1e-12)


def test_eq_10_the_channel_integrated_up_to_pinch_off() -> None:
    """Gradual channel: Id*L = mu*W times the integral of the channel charge over the channel voltage."""
    overdrive, beta = 1.3, 1e-3
    voltage = (np.arange(1000) + 0.5) * overdrive / 1000
    exact = beta * float(np.sum(overdrive - voltage)) * overdrive / 1000
    assert transistor.drain_current(2.0, 5.0, 2.0 - overdrive, beta) == pytest.approx(exact, rel=1e-9)
    assert as_printed.saturation_current(2.0, 2.0 - overdrive, beta) == pytest.approx(2 * exact, rel=1e-9)


def test_eq_11_the_wall_between_crystal_planes() -> None:
    wall = math.acos(np.dot([1, 1, 1], [0, 0, 1]) / math.sqrt(3))  # between (111) and (001)
    depth = paper.WAFER_THICKNESS.value
    assert math.degrees(wall) == pytest.approx(54.7356, abs=1e-4)
    assert mechanics.mask_opening(1e-3, depth) - 1e-3 == pytest.approx(2 * depth / math.tan(wall), abs=1e-15)


def test_eq_12_the_plate_equation_solved_on_a_grid() -> None:
    """Slope of a clamped circular plate, ``(phi' + phi/r)' = -P*r/(2*D)``, by finite differences."""
    pressure, radius, thickness = 100.0, 5e-3, 50e-6
    rigidity = SILICON[0] * thickness**3 / (12 * (1 - SILICON[1] ** 2))
    count = 2000
    r, h = np.linspace(0, radius, count + 1, retstep=True)
    inner = r[1:-1]
    diagonal = -2 / h**2 - 1 / inner**2
    upper, lower = 1 / h**2 + 1 / (2 * h * inner), 1 / h**2 - 1 / (2 * h * inner)
    slope = np.zeros(count + 1)
    slope[1:-1] = _tridiagonal(lower, diagonal, upper, -pressure * inner / (2 * rigidity))
    exact = float(np.sum(slope)) * h  # the trapezoidal rule: the slope is 0 at both ends
    right = mechanics.circular_deflection(pressure, radius, thickness, *SILICON).deflection
    assert right == pytest.approx(exact, rel=1e-5)
    assert exact / as_printed.circular_deflection(pressure, radius, thickness, *SILICON) == pytest.approx(
        math.pi, rel=1e-5
    )


def _tridiagonal(lower: np.ndarray, diagonal: np.ndarray, upper: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Thomas algorithm; lower[0] and upper[-1] are not used."""
    upper, right = upper.copy(), right.copy()
    upper[0] /= diagonal[0]
    right[0] /= diagonal[0]
    for i in range(1, right.size):
        pivot = diagonal[i] - lower[i] * upper[i - 1]
        upper[i] /= pivot
        right[i] = (right[i] - lower[i] * right[i - 1]) / pivot
    for i in range(right.size - 2, -1, -1):
        right[i] -= upper[i] * right[i + 1]
    return right


def test_eq_13_the_square_plate_solved_on_grids() -> None:
    """``D*(d4/dx4 + 2*d4/dx2dy2 + d4/dy4)y = P``, clamped, on two grids, extrapolated to zero spacing."""
    coarse, fine = _square_plate(16), _square_plate(32)
    exact = fine + (fine - coarse) / 3  # the error falls with the square of the spacing
    assert pytest.approx(exact, rel=2e-3) == mechanics.SQUARE_PLATE_COEFFICIENT
    right = mechanics.square_deflection(100.0, 1e-2, 50e-6, *SILICON).deflection
    rigidity = SILICON[0] * 50e-6**3 / (12 * (1 - SILICON[1] ** 2))
    assert right == pytest.approx(exact * 100.0 * 1e-2**4 / rigidity, rel=2e-3)
    assert as_printed.square_deflection(100.0, 1e-2, 50e-6, SILICON[0]) == pytest.approx(right, rel=2e-3)


def _square_plate(cells: int) -> float:
    """Return the centre deflection in units of P*a^4/D, by the second difference applied twice."""
    inner = cells - 1
    second = (np.eye(inner, k=1) + np.eye(inner, k=-1) - 2 * np.eye(inner)) * cells**2
    fourth = second @ second
    # Two second differences alone would make the curvature vanish at the edge. For a clamped edge, the mirror image of
    # the first inner point lies beyond the edge, which doubles the weight of that point.
    fourth[0, 0] += 2 * cells**4
    fourth[-1, -1] += 2 * cells**4
    unit = np.eye(inner)
    plate = np.kron(fourth, unit) + 2 * np.kron(second, second) + np.kron(unit, fourth)
    return float(np.linalg.solve(plate, np.ones(inner**2))[inner**2 // 2])


@pytest.mark.spice
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")
def test_table_ii_the_missing_width_of_m8_by_simulation() -> None:
    """60 um leave the offset of channel-length modulation, 2.4 mV; half and twice that width three times as much."""
    text = ngspice.netlist("opamp_b")

    def offset(width: str) -> float:
        circuit = text.replace("m8 out bias vss vss nfet w=60u", f"m8 out bias vss vss nfet w={width}")
        assert width in circuit
        return abs(float(ngspice.run_follower(circuit, "sin(0 1m 1k)", 1e-3, 1e-5).v_out[0]))

    assert offset("60u") < 3e-3
    assert min(offset("30u"), offset("120u")) > 3 * offset("60u")


@pytest.mark.spice
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")
def test_sec_v_full_feedback_is_a_voltage_follower_and_one_transistor_is_not() -> None:
    single = (
        ".subckt opamp plus minus out\n.model posfet nmos (level=1 vto=0.7 uo=850 tox=857.5n)\nvpos vdd 0 5\n"
        "vneg vss 0 -5\nm1 vdd plus out out posfet w=3276u l=12u\niss out vss 100u\nrload out 0 11k\n.ends"
    )
    gain = {
        name: abs(ngspice.run_follower_ac(circuit, highest=1e3).transfer[0])
        for name, circuit in {"amplifier": ngspice.netlist("opamp_b"), "one transistor": single}.items()
    }
    # 42.3 dB with full feedback: A0/(1 + A0). A source follower has 1/(1 + 1/(gm*RL)), and an offset of a gate voltage.
    assert gain["amplifier"] == pytest.approx(130.32 / 131.32, abs=2e-3)
    assert gain["one transistor"] < 0.9
