"""Physical constants in SI units."""

from typing import Final

VACUUM_PERMITTIVITY: Final = 8.8541878188e-12
"""Permittivity of vacuum [F/m], CODATA 2022."""

BOLTZMANN: Final = 1.380649e-23
"""Boltzmann constant [J/K], exact in the SI of 2019."""
