"""Calibration of each taxel: parameters, calibration file, least-squares fit. Imports sensor."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
