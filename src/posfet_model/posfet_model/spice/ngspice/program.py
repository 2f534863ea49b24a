# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The external program ngspice, run on a deck in a temporary folder; a run that failed is an error.

ngspice returns status 0 from many a failed run, so what it prints is read.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

PROGRAM: Final = "ngspice"

_TIMEOUT: Final = 300.0


class SpiceError(RuntimeError):
    """Raised when ngspice is missing, rejects the circuit, does not finish, or gives a run too coarse as reference."""


def available() -> bool:
    """Return whether ngspice is on PATH."""
    return shutil.which(PROGRAM) is not None


def simulate(deck: str, *, complex_values: bool) -> NDArray[np.complex128]:
    """Return the vectors of a run of ngspice on a deck, the axis first if there is one.

    Parameters
    ----------
    deck : str
        Text of the deck.
    complex_values : bool
        Whether the analysis is expected to have complex values.

    Returns
    -------
    ndarray
        Vectors, complex, shape [vectors, points].

    Raises
    ------
    SpiceError
        ngspice is missing, failed, or wrote no complete file.
    """
    program = shutil.which(PROGRAM)
    if program is None:
        raise SpiceError("ngspice is not on PATH (Debian, Ubuntu: apt-get install ngspice)")
    with tempfile.TemporaryDirectory(prefix="posfet-spice-") as folder:
        (Path(folder) / "deck.cir").write_text(deck, encoding="ascii")
        command = [program, "-n", "-b", "-r", "out.raw", "deck.cir"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=_TIMEOUT, check=False
            )
        except subprocess.TimeoutExpired:
            raise SpiceError(f"ngspice did not finish within {_TIMEOUT:g} s") from None
        raw = Path(folder) / "out.raw"
        content = raw.read_bytes() if raw.exists() else b""
    complaint = _complaint(done.stdout + "\n" + done.stderr)
    if done.returncode or complaint or not content:
        raise SpiceError(f"ngspice failed (status {done.returncode}): {complaint or 'no output'}")
    return read_raw(content, complex_values=complex_values)


def _complaint(log: str) -> str:
    """Return the first line of ngspice's log that reports a failure, or an empty string."""
    signs = (
        "error",
        "aborted",
        "too small",
        "no convergence",
        "singular matrix",
        "failed",
        "can't find",
        "unknown",
        "unrecognized",
    )
    harmless = ("gmin stepping failed", "no error")  # ngspice goes on to source stepping; if that fails it says so
    for line in log.splitlines():
        text = line.strip().lower()
        if any(sign in text for sign in signs) and not any(sign in text for sign in harmless):
            return line.strip()
    return ""


def read_raw(content: bytes, *, complex_values: bool) -> NDArray[np.complex128]:
    """Return the vectors of one plot of an ngspice binary raw file.

    Parameters
    ----------
    content : bytes
        Content of the file.
    complex_values : bool
        Whether the analysis is expected to have complex values.

    Returns
    -------
    ndarray
        Vectors, complex, shape [variables, points].

    Raises
    ------
    SpiceError
        The file is incomplete, malformed or of another analysis.
    """
    head, mark, body = content.partition(b"Binary:\n")
    fields = dict(line.split(":", 1) for line in head.decode("ascii", "replace").splitlines() if ":" in line)
    try:
        variables, points = int(fields["No. Variables"]), int(fields["No. Points"])
        is_complex = "complex" in fields["Flags"]
    except (KeyError, ValueError):
        raise SpiceError("ngspice's raw file has a malformed header") from None
    if not mark or is_complex != complex_values or not points:
        raise SpiceError("ngspice's raw file is not of the requested analysis")
    kind = np.dtype(np.complex128 if is_complex else np.float64)
    if len(body) < variables * points * kind.itemsize:
        raise SpiceError(f"ngspice's raw file ends before its {points} points")
    table = np.frombuffer(body, kind, count=variables * points).reshape(points, variables).T
    return np.asarray(table, dtype=np.complex128)
