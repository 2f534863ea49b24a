"""The whole taxel against circuits and single functions."""

import math

import numpy as np
import pytest

from posfet_model.device import charge, noise, paper
from posfet_model.device.taxel import Taxel
from posfet_model.device.transistor import Plane
from posfet_model.sensor.description import load_sensor
from support.sweep import NOT_REAL_NUMBERS, assert_refused

SMALL = Taxel(area=0.25e-6, film_thickness=5e-6, bias_resistance=1e11)


def test_a_force_gives_the_voltage_of_the_source_charge_on_the_capacitance() -> None:
    for taxel in (Taxel(), SMALL):
        coulomb = abs(taxel.piezoelectric_coefficient)  # charge of 1 N, independent of the area
        assert taxel.volts_per_newton == pytest.approx(coulomb / taxel.capacitance, rel=1e-14, abs=0)
    per_newton = noise.volts_per_newton(-38e-12, 1e-6, paper.STACK.charge_divisor(Plane.GATE))
    assert Taxel().volts_per_newton == pytest.approx(float(per_newton), rel=1e-14, abs=0)


def test_the_sensor_file_describes_the_same_taxel() -> None:
    sensor = load_sensor()
    assert Taxel().volts_per_newton * sensor.amplifier.follower_gain == pytest.approx(
        sensor.volts_per_newton, rel=1e-12
    )


def test_energy_of_the_noise_is_half_kt() -> None:
    """Equipartition: the energy of the capacitor is k*T/2 over all frequencies, for any resistor and size."""
    for taxel in (Taxel(), SMALL):
        budget = taxel.noise_budget(0.0, 0.0, 0.0, 1e-12, 1e15, temperature=310.0)
        assert 0.5 * taxel.capacitance * budget.total**2 == pytest.approx(0.5 * 1.380649e-23 * 310, rel=1e-9, abs=0)


def test_a_warming_is_equivalent_to_the_force_that_gives_the_same_charge() -> None:
    for taxel in (Taxel(), SMALL, Taxel(pyroelectric_coefficient=90e-6)):
        d33, pyro = taxel.piezoelectric_coefficient, taxel.pyroelectric_coefficient
        warmed = charge.source_charge(0.0, 1.0, d33, pyro)
        pushed = charge.source_charge(-taxel.newtons_per_kelvin / taxel.area, 0.0, d33, pyro)
        assert pushed == pytest.approx(warmed, rel=1e-14, abs=0)
    assert Taxel().newtons_per_kelvin == pytest.approx(-40 / 38, rel=1e-14, abs=0)


def test_a_steady_warming_reaches_the_stated_steady_state() -> None:
    taxel, rate, step = Taxel(), 0.5, 0.01
    density, source = 0.0, 0.0
    for _ in range(2000):
        later = source + taxel.pyroelectric_coefficient * rate * step
        density = float(charge.propagate_first_order_hold(density, source, later, step, taxel.leak_time_constant))
        source = later
    newtons = density * taxel.area / -taxel.piezoelectric_coefficient
    assert newtons == pytest.approx(taxel.newtons_per_kelvin * rate * taxel.leak_time_constant, rel=1e-9, abs=0)


def test_the_smallest_force_grows_with_the_area_where_the_adc_limits_it() -> None:
    least = [Taxel(area=a).noise_budget(0, 0, 1e-3, 0.1, 1e3).minimum_force() for a in (1e-6, 2e-6)]
    assert least[1] / least[0] == pytest.approx(2, rel=1e-2)
    silent = Taxel().noise_budget(0.0, 0.0, 0.0, 0.1, 1e3)
    assert silent.total == silent.bias
    assert np.isfinite(silent.minimum_force())


def test_a_film_poled_in_the_opposite_direction_is_equally_sensitive() -> None:
    turned = Taxel(piezoelectric_coefficient=38e-12, pyroelectric_coefficient=40e-6)
    assert turned.volts_per_newton == -Taxel().volts_per_newton
    assert turned.newtons_per_kelvin == Taxel().newtons_per_kelvin
    assert turned.noise_budget(0, 0, 1e-3, 0.1, 1e3) == Taxel().noise_budget(0, 0, 1e-3, 0.1, 1e3)


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("area", (0.0, -1e-6, 1.0)),
        ("film_thickness", (0.0, -1e-6)),
        ("film_permittivity", (0.5,)),
        ("piezoelectric_coefficient", (0.0, 1.0)),
        ("pyroelectric_coefficient", (1.0,)),
        ("bias_resistance", (0.0, -1.0)),
    ],
)
def test_invalid_arguments_are_rejected_by_name(argument: str, values: tuple[float, ...]) -> None:
    for value in (*values, *NOT_REAL_NUMBERS):
        assert_refused(Taxel, {argument: value}, argument)


def test_sizes_without_capacitance_are_rejected_by_name() -> None:
    with pytest.raises(ValueError, match="film_thickness"):
        Taxel(area=1e-12, film_thickness=1e-3, film_permittivity=1.0)


def test_results_are_finite_over_a_realistic_range_of_sizes() -> None:
    for area in (1e-12, 1e-6, 1e-2):
        for ohms in (1.0, 1e18):
            taxel = Taxel(area=area, bias_resistance=ohms)
            budget = taxel.noise_budget(0, 0, 1e-3, 0.1, 1e3)
            assert all(math.isfinite(v) for v in (taxel.leak_time_constant, budget.total, budget.minimum_force()))
