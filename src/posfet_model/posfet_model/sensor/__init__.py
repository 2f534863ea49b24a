"""The sensor: its file, taxel grid, surface, scans, signal chain from counts to charge, crosstalk. Imports device."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
