# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

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
