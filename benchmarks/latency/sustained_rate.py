"""Highest scan rate at which nothing is lost between the emulated adapter and the contacts in another process."""

from __future__ import annotations

from benchmarks.latency.end_to_end import COLUMNS, row
from benchmarks.latency.rig import Measurement, Setup, run
from benchmarks.outcome import Cell, Outcome, Table

RATES = {
    5: (1000.0, 2000.0, 4000.0, 6000.0, 8000.0, 10000.0, 12000.0),
    16: (500.0, 890.0, 1500.0, 2000.0, 3000.0, 4000.0, 5000.0),
    32: (100.0, 235.0, 500.0, 1000.0, 1500.0, 2000.0, 2500.0),
}
"""Rates that are tried [Hz], by the side of the array."""
TRIES = 2
"""A machine that was held up by something else is given another try."""
LATEST = 50_000.0
"""Delay [us] of one scan in a hundred beyond which scans pile up: it is not sustained."""


def keeps_up(taken: Measurement) -> bool:
    """Return whether every scan came, and in time."""
    return taken.written > 0 and taken.lost == 0 and taken.received == taken.written and taken.at(99) < LATEST


def highest(size: int, window: float, rows: list[tuple[Cell, ...]]) -> float:
    """Return the highest of the rates that is kept up, by bisection; 0 when none is."""
    rates = RATES[size]
    low, high = -1, len(rates)
    while high - low > 1:
        middle = (low + high) // 2
        kept = False
        for _ in range(TRIES):
            taken = run(Setup(f"posfet_{size}x{size}", rates[middle], window=window))
            rows.append(row(f"{size} x {size}, {rates[middle]:.0f} Hz", taken))
            kept = kept or keeps_up(taken)
            if kept:
                break
        low, high = (middle, high) if kept else (low, middle)
    return rates[low] if low >= 0 else 0.0


def measure(full: bool) -> Outcome:
    """Bisect for each size."""
    rows: list[tuple[Cell, ...]] = []
    window = 5.0 if full else 1.0
    values = {f"sustained_{size}x{size}_hz": highest(size, window, rows) for size in RATES}
    tried = "; ".join(f"{size} x {size}: {', '.join(f'{rate:.0f}' for rate in rates)}" for size, rates in RATES.items())
    note = (
        f"Sustained: every scan received, nothing lost, 99 of 100 within {LATEST / 1e3:.0f} ms, for {window:g} s, at "
        f"the second try at the latest. Rates to choose from [Hz]: {tried}. Real buses end earlier: 64-byte CAN FD "
        "frames at 5 Mbit/s come at 8 kHz at most."
    )
    return Outcome(values, [Table("Sustained rate", COLUMNS, rows, note)])
