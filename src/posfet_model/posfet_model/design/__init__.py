"""The device as one design: film, transistor, amplifier and ADC, to figures of merit, netlist and follower."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
