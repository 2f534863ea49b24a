"""The POSFET device as the paper describes it: film, charge, transistor, mechanics, noise. Imports only _lib."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
