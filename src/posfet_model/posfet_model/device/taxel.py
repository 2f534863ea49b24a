"""Design of one taxel: from film, area and bias resistor to sensitivity, leakage, noise and smallest detectable force.

The film is a charge source of the capacitance ``C = eps_r*eps0*A/t``, in parallel with the bias resistor R. A
compressive force F gives the voltage ``-d33*F/C`` at the gate of the stack, which leaks away with the time constant
R*C. Other loads of the film are neglected. A smaller taxel has a higher sensitivity in volts per newton, and more
noise from its resistor.
"""

from __future__ import annotations

from dataclasses import dataclass

from posfet_model._lib.validation import real_number
from posfet_model.device import noise, paper
from posfet_model.device.transistor import capacitance_per_area


@dataclass(frozen=True, kw_only=True)
class Taxel:
    """A film of one size with its bias resistor.

    The defaults are the paper's film and the coefficients of the piezo film manual.

    Examples
    --------
    >>> taxel = Taxel(area=0.25e-6, bias_resistance=100e9)
    >>> print(f"{taxel.volts_per_newton:.2f} V/N, {taxel.leak_time_constant:.2f} s, {taxel.newtons_per_kelvin:.2f} N/K")
    3.58 V/N, 1.06 s, -0.26 N/K
    """

    area: float = paper.FORCE_AREA.value
    """Area A on which the force acts [m2], in [1e-12, 1e-2]."""
    film_thickness: float = paper.FILM_THICKNESS.value
    """Thickness t of the film [m], in [1e-9, 1e-2]."""
    film_permittivity: float = paper.FILM_PERMITTIVITY.value
    """Relative permittivity of the film [1], in [1, 1e5]."""
    piezoelectric_coefficient: float = paper.PIEZOELECTRIC_COEFFICIENT.value
    """d33 [C/N], in [-1e-6, -1e-15], or positive for a film of opposite poling."""
    pyroelectric_coefficient: float = paper.PYROELECTRIC_COEFFICIENT.value
    """p [C/(m2 K)], within +-0.1; of the sign of d33."""
    bias_resistance: float = paper.BIAS_RESISTANCE.value
    """Leakage resistance R [ohm], in [1, 1e18]: the bias resistor and all other leakage in parallel."""

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
        """Capacitance C of the film [F]."""
        return float(capacitance_per_area(self.film_permittivity, self.film_thickness)) * self.area

    @property
    def leak_time_constant(self) -> float:
        """Leakage time constant R*C [s], in which the signal of a static force falls to 37 %; -3 dB at 1/(2*pi*R*C)."""
        return self.bias_resistance * self.capacitance

    @property
    def volts_per_newton(self) -> float:
        """Sensitivity -d33/C [V/N] to a compressive force before leakage; positive for d33 < 0."""
        return -self.piezoelectric_coefficient / self.capacitance

    @property
    def newtons_per_kelvin(self) -> float:  # numpydoc ignore=RT01
        """-p*A/d33 [N/K]: apparent force of a sudden temperature rise, negative (a pull) where p has the sign of d33.

        A steady heating of g [K/s] reads as ``newtons_per_kelvin*g*leak_time_constant`` in the end.
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
        """Return the noise at the gate in a band, from the bias resistor and everything behind the gate.

        Parameters
        ----------
        thermal_density, flicker_coefficient, lsb : float
            Noise of amplifier and ADC, as in `noise.noise_budget`.
        low, high : float
            Ends of the band [Hz], 1e-12 <= low < high <= 1e15.
        gain : float, default 1.0
            Gain of the follower [V/V], in [1e-3, 1e3].
        temperature : float, default 300.0
            Temperature of the resistor [K], in [1, 1000].

        Returns
        -------
        noise.NoiseBudget
            Noise of each source [V rms].

        Raises
        ------
        ValueError
            An argument is not real, not finite or out of range.
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
