# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Expected duration of a run of all tests, from the last run on this machine or from two idle cores."""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[1]
"""The folder of all tests."""
MINUTES = {True: 9, False: 19}
"""Duration of the suite on two processors of AMD EPYC: measured with workers of pytest-xdist; sequentially, estimated
by its processor time."""
QUICK = "not slow and not vm"
"""The mark expression that excludes slow tests and those of the virtual machine."""


def workers(config: pytest.Config) -> int:
    """Return the number of worker processes, 0 for a sequential run."""
    return len(getattr(config.option, "tx", None) or ())


def is_whole(config: pytest.Config) -> bool:
    """Return whether the run includes all tests, or all but the slow ones; the duration of a part is unknown."""
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
    """Return the key in the cache of pytest for the duration [s] of the last similar run."""
    return f"posfet/seconds/{workers(config)} workers, {config.option.markexpr or 'all'}"


def expected(config: pytest.Config) -> str:
    """Return a line for the header, empty for a part of the tests."""
    if not is_whole(config):
        return ""
    seconds = config.cache.get(_key(config), None) if config.cache is not None else None
    if seconds is not None:
        return f"expected time: {seconds // 60:.0f} min {seconds % 60:.0f} s, as the last run on this machine"
    alone = "" if workers(config) else ", one test after the other (less than half of it with pytest-xdist)"
    return f"expected time: about {MINUTES[workers(config) > 0]} minutes on two idle cores{alone}"


def keep(config: pytest.Config, seconds: float) -> None:
    """Store the duration [s] of a whole run for the next one."""
    if is_whole(config) and config.cache is not None:
        config.cache.set(_key(config), round(seconds))
