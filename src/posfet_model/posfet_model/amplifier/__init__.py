"""Op-amps and voltage followers: operating points, slewing, followers exact in time. Imports device."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
