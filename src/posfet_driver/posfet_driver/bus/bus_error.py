# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every exception of a backend as a failure of the bus, in one line."""

from __future__ import annotations

import can

from posfet_model._lib import shown


def one_line(error: BaseException) -> str:
    """Return the text of an exception on one line of limited length; its type when the text is empty."""
    return shown.one_line(" ".join(str(error).split())) or type(error).__name__


def bus_failure(error: Exception) -> can.CanError:
    """Return any exception of a backend as can.CanError; python-can's backends pass on many that are none.

    Parameters
    ----------
    error : Exception
        What a backend raised while it read or wrote.
    """
    if isinstance(error, can.CanError):
        return error
    # An operating-system error explains itself; the text of a KeyError does not.
    reason = one_line(error) if isinstance(error, OSError) else f"{type(error).__name__}: {one_line(error)}"
    return can.CanOperationError(reason)
