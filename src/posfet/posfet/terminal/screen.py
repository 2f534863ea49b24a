# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Display snapshots in a terminal: a live display with keys."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack
from typing import Final

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from posfet.colour_scale import nice_scale
from posfet.lines import Lines
from posfet.snapshot import OLD, Snapshot, SnapshotSource
from posfet.terminal.force_history import LEAST_SCALE, ForceHistory
from posfet.terminal.keys import TerminalKeys
from posfet.terminal.live_display import Shown, render
from posfet.terminal.log_capture import LogCapture
from posfet.web.viewed import Client

ANSWER_SHOWN = 8.0
"""Time for which the answer to a key is shown [s]."""
KEYS: Final = "q quit  p pause  t tare"


class Screen(Lines):
    """Live display; a context manager that restores the terminal.

    Parameters
    ----------
    source : SnapshotSource
        Source of the snapshots.
    client : Client, optional
        Description, diagnostics and services of the stack; None: they are not shown, and `t` does nothing.
    link : str, optional
        Link to the browser view.
    console : Console, optional
        Where to; default: standard output.
    """

    def __init__(
        self, source: SnapshotSource, client: Client | None = None, link: str = "", console: Console | None = None
    ) -> None:
        super().__init__(source)
        self._client, self._link = client, link
        self._console = console or Console()
        self._live: Live | None = None
        self._stack = ExitStack()
        self._keys, self._log = TerminalKeys(), LogCapture()
        self._history = ForceHistory()
        self._full_scale = LEAST_SCALE
        self._answer = ("", 0.0)  # to a key, and until when it is shown [s]
        self._frozen: Snapshot | None = None
        self._awaited = ""  # what is waited for, once that is known

    def __enter__(self) -> Screen:
        waiting = Text("waiting for the first scan ...")
        self._stack.enter_context(self._log)
        self._stack.enter_context(self._keys)
        self._live = Live(waiting, console=self._console, screen=True, auto_refresh=False)
        self._stack.enter_context(self._live)
        return self

    def waits(self, text: str) -> None:
        """Show what is waited for until the first scan."""
        self._awaited = text

    def close(self) -> None:
        """Restore the terminal; may be called twice."""
        self._live = None
        self._stack.close()
        super().close()

    def _react(self) -> None:
        for key in self._keys.pressed():
            if key == "q":
                self.quit = True
            elif key in "p ":
                self._frozen = None if self._frozen else self.record.last
            elif key == "t" and self._client:
                self._say("tare ...")
                self._client.request("tare", False, lambda _, text: self._say(f"tare: {text}"))
        self._log.update()

    def _say(self, text: str) -> None:
        self._answer = text, time.monotonic() + ANSWER_SHOWN

    def _message(self) -> str:
        """Return the answer to a key, or the newest line of the log; '' if there is neither."""
        text, until = self._answer
        return text if time.monotonic() < until else self._log.newest

    def _wait(self) -> None:
        if self._live:
            words = [self._awaited or "waiting for the first scan ...", self._message(), f"{KEYS}  {self._link}"]
            self._live.update(Text("\n".join(words), overflow="fold"), refresh=True)

    def _show(self, snapshot: Snapshot, scan_rate: float) -> None:
        if self._live is None:
            return
        known = snapshot.data_valid and self._age(snapshot) <= OLD
        self._history.add(snapshot.time, snapshot.total_force if known else math.nan)
        shown = self._frozen or snapshot
        self._full_scale = max(self._full_scale, nice_scale(float(np.nanmax(shown.force, initial=LEAST_SCALE))))
        array = self._client.array if self._client else None
        display = Shown(
            snapshot=shown,
            scan_rate=scan_rate,
            full_scale=self._full_scale,
            history=self._history,
            pitch=array.pitch if array else None,
            name=self._client.namespace if self._client else "",
            age=self._age(snapshot),
            advice=self._advice(),
            message=self._message(),
            paused=self._frozen is not None,
            keys=KEYS if self._keys.available else "Ctrl-C quits",
            link=self._link,
        )
        width, height = self._console.size
        self._live.update(render(display, width, height, not self._console.no_color), refresh=True)

    def _advice(self) -> str:
        """Return what the model says about its state; '' before its first report."""
        if self._client is None:
            return ""
        said = (each.text for name, each in self._client.diagnoses.items() if name.endswith("reconstruction"))
        return next(said, "")
