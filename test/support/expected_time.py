"""How long a run of all tests takes, said before it begins: that of the last run here, or of two quiet cores."""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[1]
"""The folder of all tests."""
MINUTES = {True: 5, False: 8}
"""What the suite takes on two quiet cores of 2.5 GHz: with workers of pytest-xdist, and one test after the other."""
QUICK = "not slow"
"""The mark expression that leaves out what takes long."""


def workers(config: pytest.Config) -> int:
    """Return the number of processes that share the tests, 0 where one test runs after the other."""
    return len(getattr(config.option, "tx", None) or ())


def is_whole(config: pytest.Config) -> bool:
    """Return whether the run takes all tests, or all but the slow ones: of a part nothing is known."""
    options = config.option
    narrowed = (
        options.keyword,
        options.deselect,
        options.ignore,
        options.ignore_glob,
        getattr(options, "lf", False),
        options.collectonly,
    )
    paths = {(config.invocation_params.dir / argument).resolve() for argument in config.args}
    return not any(narrowed) and options.markexpr in ("", QUICK) and paths <= {HERE, HERE.parent}


def _key(config: pytest.Config) -> str:
    """Return where pytest's cache keeps the time [s] of the last run like this one."""
    return f"posfet/seconds/{workers(config)} workers, {config.option.markexpr or 'all'}"


def expected(config: pytest.Config) -> str:
    """Return a line for the header, nothing for a part of the tests."""
    if not is_whole(config):
        return ""
    seconds = config.cache.get(_key(config), None) if config.cache is not None else None
    if seconds is not None:
        return f"expected time: {seconds // 60:.0f} min {seconds % 60:.0f} s, as the last run on this machine"
    alone = "" if workers(config) else ", one test after the other (half of it with pytest-xdist)"
    return f"expected time: about {MINUTES[workers(config) > 0]} minutes on two quiet cores{alone}"


def keep(config: pytest.Config, seconds: float) -> None:
    """Keep the time [s] that a whole run took, for the next one."""
    if is_whole(config) and config.cache is not None:
        config.cache.set(_key(config), round(seconds))
