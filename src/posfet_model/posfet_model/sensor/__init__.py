"""The sensor: its file, the layout, scans, the signal chain from count to charge, crosstalk. Imports device."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
