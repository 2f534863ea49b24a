# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The whole taxel against circuits solved by hand, its poling history, its arrays, and refusals."""

import dataclasses
import math

import numpy as np
import pytest

from posfet_model.device import charge, paper
from posfet_model.device.film import Film, remnant_after
from posfet_model.device.taxel import Taxel
from posfet_model.device.taxel_fields import FilmGeometry, plausible_fields
from posfet_model.device.transistor import Plane
from posfet_model.sensor.description import load_sensor
from support.each_row import each_row
from support.sweep import NOT_REAL_NUMBERS, assert_refused

EPS0 = 8.8541878188e-12
SMALL = Taxel(film_area=0.25e-6, film_thickness=5e-6, bias_resistance=1e11)
AS_IN_PAPER = Taxel(film_geometry=FilmGeometry.AS_IN_PAPER)


def test_the_numbers_of_a_square_millimetre_on_the_papers_gate_by_hand() -> None:
    film, gate = 12 * EPS0 * 1e-6 / 2.5e-6, 3.9 * EPS0 / 45e-9 * 3276e-6 * 12e-6
    assert (film, gate) == pytest.approx((42.5e-12, 30.17e-12), rel=1e-3, abs=0)
    taxel = Taxel()
    by_hand = {
        "film_capacitance": film,
        "gate_capacitance": gate,
        "coupling": film / (film + gate),
        "leak_time_constant": 1e10 * (film + gate),
        "newtons_per_kelvin": -40 / 38,
    }
    with each_row() as row:
        for name, value in by_hand.items():
            with row(name):
                assert getattr(taxel, name) == pytest.approx(value, rel=1e-12, abs=0)
    assert taxel.coupling == pytest.approx(0.585, abs=5e-4)
    assert taxel.leak_time_constant == pytest.approx(0.727, abs=5e-4)
    assert taxel.volts_per_newton() == pytest.approx(38e-12 / film, rel=1e-12, abs=0)
    assert taxel.volts_per_newton(Plane.OXIDE) == pytest.approx(38e-12 / (film + gate), rel=1e-12, abs=0)
    assert taxel.gain_factor() == pytest.approx(0.085 * 3.9 * EPS0 / 45e-9 * 273 * film / (film + gate), rel=1e-12)
    everywhere = math.sqrt(1.380649e-23 * 300 / (film + gate)) * (film + gate) / film
    assert taxel.bias_noise(1e-12, 1e15) == pytest.approx(everywhere, rel=1e-6, abs=0)
    assert everywhere == pytest.approx(12.9e-6, abs=5e-8)


def test_what_the_paper_does_is_a_choice_with_a_name() -> None:
    per_area = 1 / (1 + (3.9 / 45e-9) / (12 / 2.5e-6))
    assert AS_IN_PAPER.coupling == pytest.approx(per_area, rel=1e-12)
    assert per_area == pytest.approx(0.0525, abs=5e-5)
    assert Taxel().gain_factor() / AS_IN_PAPER.gain_factor() == pytest.approx(11.14, abs=5e-3)
    assert AS_IN_PAPER.gain_factor() == pytest.approx(paper.channel_gain_factor(Plane.GATE), rel=1e-12)
    assert AS_IN_PAPER.leak_time_constant == pytest.approx(0.425, abs=5e-5)
    assert AS_IN_PAPER.bias_noise(1e-12, 1e15) == pytest.approx(9.87e-6, abs=5e-9)
    assert AS_IN_PAPER.volts_per_newton() == Taxel().volts_per_newton()


@pytest.mark.parametrize("taxel", [Taxel(), SMALL, AS_IN_PAPER, Taxel(gate_width=1e-3, poling_voltages=(120.0,))])
def test_force_and_current_are_the_same_whichever_plane_is_used(taxel: Taxel) -> None:
    """Current per force in the linear region at 1 V: gain factor times sensitivity, of one plane."""
    at_gate, at_oxide = (taxel.gain_factor(plane) * taxel.volts_per_newton(plane) for plane in Plane)
    assert at_gate == pytest.approx(at_oxide, rel=1e-13, abs=0)


def test_the_charge_is_shared_between_film_and_gate() -> None:
    """Kirchhoff: with the top electrode at 0 V, 1 N puts its charge on both capacitors in parallel."""
    for taxel in (Taxel(), SMALL):
        volts = taxel.volts_per_newton(Plane.OXIDE)
        both = volts * (taxel.film_capacitance + taxel.gate_capacitance)
        assert both == pytest.approx(38e-12, rel=1e-13, abs=0)
        assert np.isclose(taxel.volts_per_newton() * taxel.film_capacitance, 38e-12, rtol=1e-13, atol=0)
    per_newton = 38e-12 / (1e-6 * paper.STACK.charge_divisor(Plane.GATE))
    assert Taxel().volts_per_newton() == pytest.approx(per_newton, rel=1e-14, abs=0)


def test_the_sensor_file_describes_the_same_taxel() -> None:
    sensor = load_sensor()
    assert Taxel().volts_per_newton() * sensor.amplifier.follower_gain == pytest.approx(
        sensor.volts_per_newton, rel=1e-12
    )


def test_a_changed_thickness_changes_all_that_depends_on_it() -> None:
    thin, thick = Taxel(poling_voltages=(100.0,)), Taxel(poling_voltages=(100.0,), film_thickness=5e-6)
    assert thick.film_capacitance == pytest.approx(thin.film_capacitance / 2, rel=1e-13)
    cf, cg = thick.film_capacitance, thick.gate_capacitance
    assert thick.coupling == pytest.approx(cf / (cf + cg), rel=1e-13)
    assert thick.gain_factor() / thin.gain_factor() == pytest.approx(thick.coupling / thin.coupling, rel=1e-13)
    assert thick.leak_time_constant == pytest.approx(1e10 * (cf + cg), rel=1e-13)
    film = Film(160e5, 0.02, 0.05, 12.0)
    for taxel, field in ((thin, 100 / 2.5e-6), (thick, 100 / 5e-6)):  # the same voltage poles a thick film less
        left = remnant_after([field], film)
        assert taxel.poled_polarisation == pytest.approx(left, rel=1e-12)
        shift = -float(taxel.uncompensated_fraction) * left / (12 * EPS0 / float(taxel.film_thickness))
        assert taxel.poling_shift == pytest.approx(shift, rel=1e-12)
        reference = 1.0 * 0.02 / 0.07  # [V]: the paper's film is saturated where the threshold voltage is given
        assert taxel.threshold == pytest.approx(0.7 + reference + shift, rel=1e-9)
        current = 0.5 * taxel.gain_factor() * (3 - taxel.threshold) ** 2 * (1 + 0.1 * 6)
        assert taxel.drain_current(3.0, 6.0, 0.1) == pytest.approx(current, rel=1e-12)
        sensitivity = 38e-12 * left / 0.02 / taxel.film_capacitance
        assert taxel.volts_per_newton() == pytest.approx(sensitivity, rel=1e-12)
    assert thin.bias_noise(1.0, 100.0) < thick.bias_noise(1.0, 100.0)


def test_poling_moves_the_threshold_and_permittivity_the_current() -> None:
    saturated, virgin, reversed_ = Taxel(), Taxel(poling_voltages=()), Taxel(poling_voltages=(200.0, -2000.0, 0.0))
    assert saturated.threshold == pytest.approx(0.7, abs=1e-12)
    assert virgin.threshold == pytest.approx(0.7 + 2 / 7, abs=1e-12)
    assert reversed_.threshold == pytest.approx(0.7 + 4 / 7, abs=1e-6)
    assert virgin.volts_per_newton() == 0
    assert reversed_.volts_per_newton() == pytest.approx(-saturated.volts_per_newton(), rel=1e-6)
    assert Taxel(poling_voltages=(), uncompensated_fraction=0.0).threshold == 0.7
    weak = Taxel(film_permittivity=7.5)
    assert weak.threshold == pytest.approx(0.7 + 2 / 7 - 2 / 7 * 12 / 7.5, abs=1e-12)
    film, gate = 7.5 * EPS0 * 1e-6 / 2.5e-6, saturated.gate_capacitance
    current = 0.5 * 0.085 * 3.9 * EPS0 / 45e-9 * 273 * film / (film + gate) * (1.7 - weak.threshold) ** 2
    assert weak.drain_current(1.7, 5.0) == pytest.approx(current, rel=1e-12)


def test_the_gate_plane_moves_by_one_volt_for_the_papers_switched_polarisation() -> None:
    """kappa is assumed so that Ps + Pr, 0.07 C/m2 on 42.5 uF/m2, shift the threshold by 1 V."""
    assert paper.UNCOMPENSATED_FRACTION.value * 0.07 / (12 * EPS0 / 2.5e-6) == pytest.approx(1, rel=1e-12)
    assert paper.UNCOMPENSATED_FRACTION.value == pytest.approx(0.00060714, abs=5e-9)


def test_energy_of_the_noise_is_half_kt() -> None:
    """Equipartition: the energy of the node's capacitance is k*T/2 over all frequencies, for any resistor and size."""
    for taxel in (Taxel(), SMALL):
        volts = taxel.bias_noise(1e-12, 1e15, 310.0) * taxel.coupling
        energy = 0.5 * (taxel.film_capacitance + taxel.gate_capacitance) * volts**2
        assert energy == pytest.approx(0.5 * 1.380649e-23 * 310, rel=1e-9, abs=0)


def test_a_warming_is_equivalent_to_the_force_that_gives_the_same_charge() -> None:
    for taxel in (Taxel(), SMALL, Taxel(pyroelectric_coefficient=90e-6)):
        d33, pyro = taxel.piezoelectric_coefficient, taxel.pyroelectric_coefficient
        warmed = charge.source_charge(0.0, 1.0, d33, pyro)
        pushed = charge.source_charge(-taxel.newtons_per_kelvin / taxel.film_area, 0.0, d33, pyro)
        assert pushed == pytest.approx(warmed, rel=1e-14, abs=0)


def test_a_steady_warming_reaches_the_stated_steady_state() -> None:
    taxel, rate, step = Taxel(), 0.5, 0.02
    density, source = 0.0, 0.0
    for _ in range(1200):
        later = source + taxel.pyroelectric_coefficient * rate * step
        density = float(charge.propagate_first_order_hold(density, source, later, step, taxel.leak_time_constant))
        source = later
    newtons = density * taxel.film_area / -taxel.piezoelectric_coefficient
    assert newtons == pytest.approx(taxel.newtons_per_kelvin * rate * taxel.leak_time_constant, rel=1e-9, abs=0)


ARRAYS = {
    "film_area": np.array([[0.25e-6], [1e-6]]),
    "film_thickness": np.array([1e-6, 2.5e-6, 7e-6]),
    "gate_width": np.array([[[1e-3]], [[3276e-6]]]),
    "remnant_polarisation": np.array([0.02, 0.03, 0.01]),
}


@pytest.mark.parametrize("geometry", FilmGeometry)
def test_arrays_give_what_each_element_gives(geometry: FilmGeometry) -> None:
    volts = np.array([[30.0], [90.0]])
    whole = Taxel(**ARRAYS, poling_voltages=(volts, -10.0), film_geometry=geometry)
    assert whole.shape == (2, 2, 3)
    names = "coupling gate_capacitance leak_time_constant threshold newtons_per_kelvin poled_fraction film_on_gate"
    for at in np.ndindex(whole.shape):
        fields = {name: float(np.broadcast_to(value, whole.shape)[at]) for name, value in ARRAYS.items()}
        poling = (float(np.broadcast_to(volts, whole.shape)[at]), -10.0)
        one = Taxel(**fields, poling_voltages=poling, film_geometry=geometry)
        assert one.shape == ()
        for name in names.split():
            assert np.broadcast_to(getattr(whole, name), whole.shape)[at] == getattr(one, name), name
        for name, arguments in {"volts_per_newton": (), "gain_factor": (), "bias_noise": (0.1, 1e3)}.items():
            assert np.broadcast_to(getattr(whole, name)(*arguments), whole.shape)[at] == getattr(one, name)(*arguments)
        assert whole.drain_current(2.0, 1.0)[at] == one.drain_current(2.0, 1.0)


WRONG_UNITS = {
    "film_area": (1.0, "mm2"),
    "film_thickness": (2.5, "um"),
    "piezoelectric_coefficient": (-38.0, "pC/N"),
    "pyroelectric_coefficient": (-40.0, "uC/(m2 K)"),
    "coercive_field": (160.0, "kV/cm"),
    "remnant_polarisation": (2.0, "uC/cm2"),
    "saturation_polarisation": (5.0, "uC/cm2"),
    "gate_width": (3276.0, "um"),
    "gate_length": (12.0, "um"),
    "oxide_thickness": (45.0, "nm"),
    "electron_mobility": (850.0, "cm2/(V s)"),
    "threshold_voltage": (700.0, "mV"),
    "bias_resistance": (10.0, "Gohm"),
}


@pytest.mark.parametrize("name", WRONG_UNITS)
def test_a_number_in_another_unit_is_refused_with_both_units(name: str) -> None:
    number, unit = WRONG_UNITS[name]
    expected = plausible_fields(Taxel)[name].unit
    for value in (number, np.array([getattr(Taxel(), name), number])):
        with pytest.raises(ValueError) as caught:
            Taxel(**{name: value})
        text = str(caught.value)
        assert "\n" not in text
        assert text.startswith(f"{name} must be")
        assert f" {expected}, got {number:g}; meant in {unit}? {number:g} {unit} is " in text


def test_invalid_arguments_are_rejected_by_name() -> None:
    with each_row() as row:
        for name in plausible_fields(Taxel):
            for value in (*NOT_REAL_NUMBERS, 1e30):
                with row(f"{name} {value!r}"):
                    assert_refused(Taxel, {name: value}, name)
    assert_refused(Taxel, {"remnant_polarisation": 0.05}, "remnant_polarisation")
    assert_refused(Taxel, {"poling_voltages": (1e6,)}, "poling_voltages")
    with pytest.raises(ValueError, match=r"film_area \(2,\), film_thickness \(3,\)"):
        Taxel(film_area=np.full(2, 1e-6), film_thickness=np.full(3, 1e-6))
    with pytest.raises(ValueError, match=r"poling_voltages\[0\] \(2,\)"):
        Taxel(film_thickness=np.full(3, 1e-6), poling_voltages=(np.ones(2),))


def test_results_are_finite_at_the_ends_of_all_ranges() -> None:
    for name, plausible in plausible_fields(Taxel).items():
        for value in (plausible.low, plausible.high):
            if name in {"remnant_polarisation", "saturation_polarisation"}:
                continue
            taxel = dataclasses.replace(Taxel(), **{name: value})
            numbers = (taxel.coupling, taxel.leak_time_constant, taxel.threshold, taxel.volts_per_newton())
            assert all(math.isfinite(number) for number in numbers), name
