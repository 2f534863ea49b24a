"""Processing pipeline of one scan: counts in, force image and contacts out. Imports estimation, contacts and below."""

from posfet_model._lib.lazy import lazy_submodules

__getattr__, __dir__ = lazy_submodules(__name__, __path__)
