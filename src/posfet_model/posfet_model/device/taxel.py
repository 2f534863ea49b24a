"""One taxel as its designer sees it: from film, area and bias resistor to sensitivity, leak, noise, smallest force.

The film is a charge source of the capacitance ``C = eps_r*eps0*A/t``, with the bias resistor R across it. A push F
gives the voltage ``-d33*F/C`` at the gate of the stack, which leaks away with R*C. What else loads the film is left
out. A smaller taxel gives more volts for a newton, and more noise of its resistor.
"""

from __future__ import annotations

from dataclasses import dataclass

from posfet_model._lib.validation import real_number
from posfet_model.device import noise, paper
from posfet_model.device.transistor import capacitance_per_area


@dataclass(frozen=True, kw_only=True)
class Taxel:
    """A film of one size with its bias resistor. Defaults: the paper's film, the piezo film manual's coefficients.

    Examples
    --------
    >>> taxel = Taxel(area=0.25e-6, bias_resistance=100e9)
    >>> print(f"{taxel.volts_per_newton:.2f} V/N, {taxel.leak_time_constant:.2f} s, {taxel.newtons_per_kelvin:.2f} N/K")
    3.58 V/N, 1.06 s, -0.26 N/K
    """

    area: float = paper.FORCE_AREA.value
    """That the force acts on [m2], in [1e-12, 1e-2]."""
    film_thickness: float = paper.FILM_THICKNESS.value
    """[m], in [1e-9, 1e-2]."""
    film_permittivity: float = paper.FILM_PERMITTIVITY.value
    """Relative [1], in [1, 1e5]."""
    piezoelectric_coefficient: float = paper.PIEZOELECTRIC_COEFFICIENT.value
    """d33 [C/N], in [-1e-6, -1e-15], or positive for a film poled the other way round."""
    pyroelectric_coefficient: float = paper.PYROELECTRIC_COEFFICIENT.value
    """p [C/(m2 K)], within +-0.1; of the sign of d33."""
    bias_resistance: float = paper.BIAS_RESISTANCE.value
    """R [ohm], in [1, 1e18], whatever else leaks included."""

    def __post_init__(self) -> None:
        real_number("area", self.area, 1e-12, 1e-2)
        real_number("film_thickness", self.film_thickness, 1e-9, 1e-2)
        real_number("film_permittivity", self.film_permittivity, 1, 1e5)
        real_number("piezoelectric_coefficient", self.piezoelectric_coefficient, -1e-6, 1e-6)
        if abs(self.piezoelectric_coefficient) < 1e-15:
            raise ValueError(
                f"piezoelectric_coefficient must be 1e-15 or more in magnitude, got {self.piezoelectric_coefficient:g}"
            )
        real_number("pyroelectric_coefficient", self.pyroelectric_coefficient, -0.1, 0.1)
        real_number("bias_resistance", self.bias_resistance, 1, 1e18)
        real_number("capacitance of this area, film_thickness and film_permittivity", self.capacitance, 1e-18, 1)

    @property
    def capacitance(self) -> float:
        """C of the film [F]."""
        return float(capacitance_per_area(self.film_permittivity, self.film_thickness)) * self.area

    @property
    def leak_time_constant(self) -> float:
        """R*C [s]: a held force has fallen to 37 % after it. Below 1/(2*pi*R*C) the taxel hears ever less."""
        return self.bias_resistance * self.capacitance

    @property
    def volts_per_newton(self) -> float:
        """-d33/C [V/N] of a push at once, before any of it leaks; positive for d33 < 0."""
        return -self.piezoelectric_coefficient / self.capacitance

    @property
    def newtons_per_kelvin(self) -> float:
        """-p*A/d33 [N/K]: the push that a warming at once is taken for, negative (a pull) where p has d33's sign.

        A steady warming of g [K/s] ends up as ``newtons_per_kelvin*g*leak_time_constant``.
        """
        return -self.pyroelectric_coefficient * self.area / self.piezoelectric_coefficient

    def noise_budget(
        self,
        thermal_density: float,
        flicker_coefficient: float,
        lsb: float,
        low: float,
        high: float,
        *,
        gain: float = 1.0,
        temperature: float = 300.0,
    ) -> noise.NoiseBudget:
        """Return the noise at the gate in the band low..high [Hz], of the bias resistor and what is behind the gate.

        temperature is that of the resistor [K], in [1, 1000]; the others and errors as in `noise.noise_budget`.
        """
        return noise.noise_budget(
            noise.bias_resistor_rms(self.bias_resistance, self.capacitance, temperature, low, high),
            thermal_density,
            flicker_coefficient,
            lsb,
            abs(self.volts_per_newton),
            low,
            high,
            gain,
        )
