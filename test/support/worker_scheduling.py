"""Distribution of the tests among the workers of pytest-xdist, by scope.

The mark xdist_group of pytest-xdist has no effect with pytest 9.2.
"""

from __future__ import annotations

from xdist.scheduler import LoadScopeScheduling

from support.worker_scope import scope


class ScopeScheduling(LoadScopeScheduling):
    """Assigns whole scopes to a worker, one as soon as it is idle."""

    def _split_scope(self, nodeid: str) -> str:
        return scope(nodeid)
