"""Contacts in a force image: detection, moments, separation, tracking, slip. Imports sensor; never estimation."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
