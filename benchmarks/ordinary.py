"""The stack beside one built the ordinary way (`benchmarks.ordinary_stack`): same board, scene, rate and listener.

The rate is one that the ordinary stack keeps up with; what it makes of 1 kHz is shown, too.
"""

from __future__ import annotations

from dataclasses import replace

from benchmarks.latency import COLUMNS, row
from benchmarks.outcome import Outcome, Table
from benchmarks.rig import Setup, run

RATE = 250.0


def measure(full: bool) -> Outcome:
    """Measure both at the same rate, one after the other."""
    base = Setup(rate=RATE, window=5.0 if full else 3.0)
    ours, separate = run(base), run(replace(base, stack="separate"))
    ordinary = run(replace(base, stack="ordinary"))
    fast = run(replace(base, stack="ordinary", rate=1000.0, window=2.0))
    values = {
        "ordinary_stack_latency_ratio": ordinary.at(50) / ours.at(50),
        "ordinary_stack_cpu_ratio": ordinary.cpu / ours.cpu,
        "ordinary_stack_latency_ratio_separate": ordinary.at(50) / separate.at(50),
        "ordinary_stack_cpu_ratio_separate": ordinary.cpu / separate.cpu,
        "ordinary_stack_latency_p50_us": ordinary.at(50),
        "ordinary_stack_received_at_1khz_pct": 100 * fast.received / max(fast.written, 1),
    }
    rows = [
        row("this stack, 250 Hz, composed", ours),
        row("this stack, 250 Hz, separate", separate),
        row("ordinary stack, 250 Hz", ordinary),
        row("ordinary stack, 1 kHz", fast),
    ]
    note = "Lost frames of the ordinary stack are only those that the adapter could not hand over: it does not count."
    return Outcome(values, [Table("This stack and an ordinary one", COLUMNS, rows, note)])
