"""Runs of ngspice, their files, and the comparison of follower models with them. Imports amplifier and device."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
