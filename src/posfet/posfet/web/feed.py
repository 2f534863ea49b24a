# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The newest text of each kind, for any number of readers: none has a queue, and none holds up the writer."""

from __future__ import annotations

import threading
from collections.abc import Mapping


class Feed:
    """Newest texts by kind. A reader that was busy gets the newest one next, and not those in between."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._texts: dict[str, tuple[int, bytes]] = {}
        self._version = 0
        self._readers = 0
        self._closed = False

    @property
    def readers(self) -> int:
        """Number of readers."""
        return self._readers

    @property
    def closed(self) -> bool:
        """Whether there is nothing more to come."""
        return self._closed

    def enter(self, most: int) -> bool:
        """Count a reader in; return whether there was room for it.

        Parameters
        ----------
        most : int
            Greatest number of readers.
        """
        with self._changed:
            if self._readers >= most:
                return False
            self._readers += 1
            self._changed.notify_all()
            return True

    def leave(self) -> None:
        """Count a reader out."""
        with self._changed:
            self._readers -= 1

    def wait_for_reader(self, timeout: float) -> bool:
        """Return whether there is a reader, after at most `timeout` seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: self._readers > 0 or self._closed, timeout) and not self._closed

    def put(self, kind: str, text: bytes) -> None:
        """Replace the text of a kind; nothing happens if it is the same."""
        with self._changed:
            if self._texts.get(kind, (0, b""))[1] != text:
                self._version += 1
                self._texts[kind] = self._version, text
                self._changed.notify_all()

    def newer(self, seen: Mapping[str, int], timeout: float) -> dict[str, tuple[int, bytes]]:
        """Return version and text of each kind that is newer than what was seen; empty after the time or the end.

        Parameters
        ----------
        seen : mapping of str to int
            Versions that the reader has, by kind.
        timeout : float
            Longest time to wait [s].
        """
        with self._changed:
            found: dict[str, tuple[int, bytes]] = {}

            def any_new() -> bool:
                found.update({kind: each for kind, each in self._texts.items() if each[0] > seen.get(kind, 0)})
                return bool(found) or self._closed

            self._changed.wait_for(any_new, timeout)
            return found

    def close(self) -> None:
        """Let all readers end."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
