"""Shares the tests among the workers of pytest-xdist, by scope.

Its own way, the mark xdist_group, has no effect with pytest 9.2.
"""

from __future__ import annotations

from xdist.scheduler import LoadScopeScheduling

from support.worker_scope import scope


class ScopeScheduling(LoadScopeScheduling):
    """Gives a worker what it has to run as a whole, as soon as it has nothing left to do."""

    def _split_scope(self, nodeid: str) -> str:
        return scope(nodeid)
