"""Runs of the follower circuits in ngspice, an external program; an incomplete or too coarse run is an error.

The circuits are op-amps as subcircuits in the package folder `netlists`: `opamp_b` (two Miller-compensated stages) and
`opamp_c` (one stage and an output follower). This module adds a source and an analysis, runs ngspice in a temporary
folder, and reads its binary output. ngspice returns status 0 from many a failed run, so the result is checked.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.validation import real_array, real_number, whole_number
from posfet_model.amplifier.closed_loop import ClosedLoop

CIRCUITS: Final = ("opamp_b", "opamp_c")
"""Names of the netlists that come with the package."""

PROGRAM: Final = "ngspice"

FOLLOWER: Final = "xdut in out out opamp"
"""The op-amp as a follower, between the nodes in and out of a deck."""

RELATIVE_TOLERANCE: Final = 1e-5
"""reltol of all runs; with ngspice's default of 1e-3 the error on steps of these circuits is several percent of full
scale."""

COARSEST_OUTPUT_STEP: Final = 0.05
"""Largest change of the output from sample to sample of a resolved run, relative to its peak-to-peak [1]."""

_TIMEOUT: Final = 300.0
_LEAST_TIME_STEPS: Final = 20


class SpiceError(RuntimeError):
    """Raised when ngspice is missing, rejects the circuit, does not finish, or gives a run too coarse as reference."""


@dataclass(frozen=True)
class Transient:
    """A transient analysis, all fields of shape [t]."""

    time: NDArray[np.float64]
    """[s], uneven steps."""
    v_in: NDArray[np.float64]
    """Input voltage [V]."""
    v_out: NDArray[np.float64]
    """Output voltage [V]."""


@dataclass(frozen=True)
class SmallSignal:
    """A small-signal AC analysis, both fields of shape [f]."""

    frequency: NDArray[np.float64]
    """[Hz], logarithmically spaced."""
    transfer: NDArray[np.complex128]
    """Transfer function v_out/v_in [V/V]."""


def available() -> bool:
    """Return whether ngspice is on PATH."""
    return shutil.which(PROGRAM) is not None


def netlist(circuit: str) -> str:
    """Return the text of a netlist of the package.

    Parameters
    ----------
    circuit : str
        One of `CIRCUITS`.

    Returns
    -------
    str
        Text of the netlist.

    Raises
    ------
    ValueError
        There is no netlist of that name.
    """
    if circuit not in CIRCUITS:
        raise ValueError(f"circuit must be one of {', '.join(CIRCUITS)}, got {circuit!r}")
    return (files("posfet_model.spice") / "netlists" / f"{circuit}.cir").read_text(encoding="ascii")


def piecewise_linear(time: ArrayLike, volts: ArrayLike) -> str:
    """Return a piecewise linear ngspice source.

    Parameters
    ----------
    time : array_like
        Times of the points [s], shape [k], k >= 2, starting at 0 and increasing, at most 1e6.
    volts : array_like
        Voltages of the points [V], shape [k], within +-1e3.

    Returns
    -------
    str
        The source, for `run_follower`.

    Raises
    ------
    ValueError
        An argument is not real, not finite, out of range or of another shape, or the times do not increase from 0.
    """
    instants = real_array("time", time, 0, 1e6)
    levels = real_array("volts", volts, -1e3, 1e3)
    if instants.ndim != 1 or instants.shape != levels.shape or instants.size < 2:
        raise ValueError(f"time and volts must be of one shape [k], k >= 2, got {instants.shape} and {levels.shape}")
    if instants[0] != 0 or not (np.diff(instants) > 0).all():
        raise ValueError(
            f"time must rise from 0, got {instants[0]:g} first and steps down to {np.diff(instants).min():g}"
        )
    points = "\n".join(f"+ {t:.12g} {v:.12g}" for t, v in zip(instants, levels, strict=True))
    return f"pwl(\n{points}\n+ )"


def run_follower(
    circuit: str, source: str, stop: float, largest_step: float, relative_tolerance: float = RELATIVE_TOLERANCE
) -> Transient:
    """Return the follower's response to a source, complete and resolved.

    Parameters
    ----------
    circuit : str
        Text of a netlist with a subcircuit ``opamp plus minus out`` that contains its own supplies.
    source : str
        An ngspice source such as from `piecewise_linear`, or "sin(0 1 1k)".
    stop : float
        End of the run [s], in (0, 1e6].
    largest_step : float
        Upper limit of ngspice's time step [s], at most stop/20.
    relative_tolerance : float, default RELATIVE_TOLERANCE
        ngspice's reltol [1], in [1e-9, 1e-2].

    Returns
    -------
    Transient
        Input and output over time.

    Raises
    ------
    ValueError
        `stop`, `largest_step` or `relative_tolerance` is out of range.
    SpiceError
        ngspice failed, or the run is incomplete or too coarse; the message says why.
    """
    stop = real_number("stop", stop, 1e-12, 1e6)
    largest_step = real_number("largest_step", largest_step, stop * 1e-9, stop / _LEAST_TIME_STEPS)
    tolerance = real_number("relative_tolerance", relative_tolerance, 1e-9, 1e-2)
    analysis = f".tran {largest_step:.12g} {stop:.12g} 0 {largest_step:.12g}"
    source = f"vin in 0 {source}"
    values = _simulate(_deck(circuit, source, FOLLOWER, analysis, tolerance=tolerance), complex_values=False)
    run = Transient(time=values[0].real, v_in=values[1].real, v_out=values[2].real)
    _check_transient(run, stop, largest_step)
    return run


def run_follower_ac(circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50) -> SmallSignal:
    """Return the follower's small-signal transfer function.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        Ends of the frequency range [Hz], from 1e-3 to 1e13, at least a decade apart.
    per_decade : int, default 50
        Frequencies per decade, in [1, 10000].

    Returns
    -------
    SmallSignal
        Transfer function v_out/v_in.

    Raises
    ------
    ValueError
        A frequency or `per_decade` is out of range.
    SpiceError
        ngspice failed or the run is incomplete.
    """
    return _run_ac(circuit, FOLLOWER, lowest, highest, per_decade)


def run_open_loop_ac(circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50) -> SmallSignal:
    """Return the op-amp's open-loop transfer function at the follower's operating point.

    The loop is closed at 0 Hz only, through 1 GH, with 1 F to ground at the inverting input.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        Ends of the frequency range [Hz], from 1e-3 to 1e13, at least a decade apart.
    per_decade : int, default 50
        Frequencies per decade, in [1, 10000].

    Returns
    -------
    SmallSignal
        Transfer function v_out/v_in.

    Raises
    ------
    ValueError
        A frequency or `per_decade` is out of range.
    SpiceError
        ngspice failed or the run is incomplete.
    """
    loop = "lloop out feedback 1g\ncloop feedback 0 1\nxdut in feedback out opamp"
    return _run_ac(circuit, loop, lowest, highest, per_decade)


def run_loop_gain(
    circuit: str, lowest: float = 1.0, highest: float = 1e8, per_decade: int = 50, v_in: float = 0.0
) -> SmallSignal:
    """Return the loop gain of the follower, with a voltage source in the closed loop at the inverting input.

    The output keeps its load by the inverting input, and the operating point is the follower's, in contrast to
    `run_open_loop_ac`. Exact but for the ratio of the impedances of output and inverting input.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    lowest, highest : float
        Ends of the frequency range [Hz], from 1e-3 to 1e13, at least a decade apart.
    per_decade : int, default 50
        Frequencies per decade, in [1, 10000].
    v_in : float, default 0.0
        Input at rest [V], within +-1e3.

    Returns
    -------
    SmallSignal
        Loop gain, positive at low frequency.

    Raises
    ------
    ValueError
        A frequency, `per_decade` or `v_in` is out of range.
    SpiceError
        ngspice failed or the run is incomplete.
    """
    loop = "vloop out feedback dc 0 ac -1\nxdut in feedback out opamp"
    volts = f"{real_number('v_in', v_in, -1e3, 1e3):.12g}"
    frequency, (feedback, out) = _ac(circuit, loop, volts, ("feedback", "out"), lowest, highest, per_decade)
    return SmallSignal(frequency=frequency, transfer=-out / feedback)


def closed_loop(response: SmallSignal) -> ClosedLoop:
    """Return gain at the lowest frequency and -3 dB frequency of a follower.

    Between the frequencies of the run, the gain is interpolated linearly in doubly logarithmic scale.

    Parameters
    ----------
    response : SmallSignal
        Transfer function of the follower.

    Returns
    -------
    ClosedLoop
        Gain [V/V] and bandwidth [Hz].

    Raises
    ------
    SpiceError
        The gain does not fall by 3 dB within the run.
    """
    gain = np.abs(response.transfer)
    fallen = np.flatnonzero(gain < gain[0] / math.sqrt(2))
    if not fallen.size or fallen[0] == 0:
        raise SpiceError(f"the gain does not fall by 3 dB below {response.frequency[-1]:g} Hz")
    ends = slice(fallen[0] - 1, fallen[0] + 1)
    logarithm = np.interp(-math.log(gain[0] / math.sqrt(2)), -np.log(gain[ends]), np.log(response.frequency[ends]))
    return ClosedLoop(gain=float(gain[0]), bandwidth=math.exp(float(logarithm)))


def _run_ac(circuit: str, instance: str, lowest: float, highest: float, per_decade: int) -> SmallSignal:
    frequency, (v_in, v_out) = _ac(circuit, instance, "0 ac 1", ("in", "out"), lowest, highest, per_decade)
    return SmallSignal(frequency=frequency, transfer=v_out / v_in)


def _ac(
    circuit: str, instance: str, source: str, nodes: tuple[str, str], lowest: float, highest: float, per_decade: int
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Return the frequencies and the voltages of two nodes."""
    lowest = real_number("lowest", lowest, 1e-3, 1e12)
    highest = real_number("highest", highest, 10 * lowest, 1e13)
    per_decade = whole_number("per_decade", per_decade, 1, 10_000)
    analysis = f".ac dec {per_decade} {lowest:.12g} {highest:.12g}"
    saved = [f"v({node})" for node in nodes]
    values = _simulate(_deck(circuit, f"vin in 0 dc {source}", instance, analysis, saved), complex_values=True)
    frequency = values[0].real
    if abs(frequency[-1] / highest - 1) > 0.1:
        raise SpiceError(f"ngspice stopped at {frequency[-1]:g} Hz of {highest:g} Hz")
    return frequency, values[1:]


def run_operating_point(circuit: str, quantities: Sequence[str]) -> NDArray[np.float64]:
    """Return quantities of the operating point of the follower, with its input at 0 V.

    Parameters
    ----------
    circuit : str
        Text of a netlist, as in `run_follower`.
    quantities : sequence of str
        What ngspice is to save, such as "v(out)" or "@m.xdut.m1[gm]".

    Returns
    -------
    ndarray
        Their values in SI units, shape [quantities].

    Raises
    ------
    SpiceError
        ngspice failed or does not know a quantity.
    """
    values = _simulate(_deck(circuit, "vin in 0 dc 0", FOLLOWER, ".op", quantities), complex_values=False)
    if values.shape != (len(quantities), 1):
        raise SpiceError(f"ngspice saved {values.shape[0]} of {len(quantities)} quantities of the operating point")
    return values[:, 0].real


def _deck(
    circuit: str,
    source: str,
    instance: str,
    analysis: str,
    saved: Sequence[str] = ("v(in)", "v(out)"),
    tolerance: float = RELATIVE_TOLERANCE,
) -> str:
    options = f".options method=gear reltol={tolerance:g} abstol=1e-14 vntol=1e-9 chgtol=1e-18 trtol=1 gmin=1e-15"
    return "\n".join(["follower", circuit, source, instance, options, f".save {' '.join(saved)}", analysis, ".end", ""])


def _simulate(deck: str, *, complex_values: bool) -> NDArray[np.complex128]:
    """Run ngspice on a deck and return its vectors, the axis first if there is one, shape [vectors, points]."""
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


def _check_transient(run: Transient, stop: float, largest_step: float) -> None:
    """Raise SpiceError unless the run is finite, complete and fine enough."""
    if not all(np.isfinite(part).all() for part in (run.time, run.v_in, run.v_out)):
        raise SpiceError("ngspice's run contains values that are not finite")
    if abs(run.time[-1] - stop) > 1e-6 * stop:
        raise SpiceError(f"ngspice stopped at {run.time[-1]:g} s of {stop:g} s")
    steps = np.diff(run.time)
    if steps.min() < 0 or steps.max() > largest_step * (1 + 1e-6):
        raise SpiceError(
            f"ngspice's steps range from {steps.min():g} to {steps.max():g} s, at most {largest_step:g} s is allowed"
        )
    jump, swing = np.abs(np.diff(run.v_out)).max(), np.ptp(run.v_out)
    if jump > COARSEST_OUTPUT_STEP * swing:
        raise SpiceError(
            f"the run is too coarse: the output changes by {100 * jump / swing:.1f} % of its swing in one step"
        )
