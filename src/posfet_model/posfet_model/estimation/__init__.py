"""Static force from a leaking charge signal: leakage compensation, baseline tracking, temperature, uncertainty.

Imports calibration and sensor.
"""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
