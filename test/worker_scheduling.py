"""Shares the tests among the workers of pytest-xdist, by scope.

Its own way, the mark xdist_group, has no effect with pytest 9.2.
"""

from __future__ import annotations

from worker_scope import scope
from xdist.scheduler import LoadScopeScheduling


class ScopeScheduling(LoadScopeScheduling):
    """Gives a worker what it has to run as a whole, as soon as it has nothing left to do."""

    def _split_scope(self, nodeid: str) -> str:
        return scope(nodeid)
