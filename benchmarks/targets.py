# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Performance targets, for a machine with two processors of 2.5 GHz."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.outcome import shown


@dataclass(frozen=True)
class Target:
    """Two limits of one value: upper limits (the default), or lower limits."""

    name: str
    what: str
    limits: tuple[float, float]
    """Limits for "pass" and for "stretch"."""
    at_least: bool = False

    def text(self, which: int) -> str:
        """Return one of the limits as text."""
        return f"{'>=' if self.at_least else '<='} {shown(self.limits[which])}"

    def verdict(self, value: float) -> str:
        """Return stretch, pass or short."""
        sign = -1.0 if self.at_least else 1.0
        passed, stretched = (sign * value <= sign * limit for limit in self.limits)
        return "stretch" if stretched else "pass" if passed else "short"


TARGETS = (
    Target("latency_5x5_1khz_p50_us", "CAN frame to contacts in another process, median", (350, 200)),
    Target("latency_5x5_1khz_p99_us", "the same, 99th percentile", (600, 400)),
    Target("ready_5x5_1khz_p50_us", "CAN frame to contacts ready, median", (170, 100)),
    Target("ready_5x5_1khz_p99_us", "the same, 99th percentile", (300, 200)),
    Target("driver_cpu_5x5_1khz_pct", "share of a core, driver and model, with contact", (25, 15)),
    Target("driver_cpu_idle_pct", "the same, without contact", (16, 10)),
    Target("ready_touched_over_echo", "contacts ready, median, over that of an echo of the same run", (1.4, 1.0)),
    Target("ready_idle_over_echo", "the same, without contact", (1.2, 0.9)),
    Target("latency_p50_over_echo", "latency, median, over that of an echo", (1.15, 1.0)),
    Target("latency_p99_over_echo", "the same, 99th percentile", (1.4, 1.0)),
    Target("cpu_touched_over_echo", "processor time over that of an echo", (2.0, 1.2)),
    Target("cpu_idle_over_echo", "the same, without contact", (1.5, 1.0)),
    Target("cpu_4khz_pct", "share of a core at 4 kHz", (30, 20)),
    Target("offline_5x5_scans_per_s", "reconstruction of recorded scans, 5 x 5", (100e3, 300e3), at_least=True),
    Target("sustained_5x5_hz", "5 x 5, without loss", (4000, 8000), at_least=True),
    Target(
        "sustained_5x5_loaded_hz",
        "the same beside one busy process for each processor",
        (8000, 8000),
        at_least=True,
    ),
    Target("sustained_5x5_loaded_p99_ms", "latency at that rate, 99th percentile", (50, 5)),
    Target("sustained_16x16_hz", "16 x 16, without loss", (890, 3000), at_least=True),
    Target("sustained_32x32_hz", "32 x 32, without loss", (235, 2000), at_least=True),
    Target("slcan_fd_ratio", "slcan FD frames per second over those of python-can", (50, 150), at_least=True),
    Target("decode_mapped_5x5_fd_ratio", "a scan of a board with frames of its own over one of ours, FD", (2.0, 1.25)),
    Target("decode_mapped_5x5_classic_ratio", "the same, classic frames", (2.0, 1.25)),
    Target("sim_vs_ngspice_64", "speed over ngspice, 64 followers at equal step", (20, 100), at_least=True),
    Target("sim_vs_ngspice_4096", "speed over ngspice, 4096 followers", (200, 1000), at_least=True),
    Target("sim_5x5_cpu_pct", "simulated 5 x 5 board at 1 kHz, share of a core", (5, 2)),
    Target("sim_64x64_realtime_factor", "simulated 64 x 64 board, real-time factor", (20, 30), at_least=True),
    Target("mcap_5x5_realtime_factor", "posfet sim into an MCAP file, real-time factor", (2.5, 4), at_least=True),
    Target("startup_s", "process start to first contacts message", (1.0, 0.5)),
    Target("startup_over_imports", "the same over the import of rclpy.node and NumPy", (1.8, 1.4)),
    Target("setup_s", "make build in a fresh clone", (60, 40)),
    Target("web_cpu_pct", "browser view, share of a core above the bring-up", (10, 5)),
    Target("web_behind_p99_ms", "browser view behind the sensor, 99th percentile [ms]", (100, 50)),
    Target(
        "ordinary_stack_latency_ratio",
        "latency of the baseline implementation over ours",
        (1, 2),
        at_least=True,
    ),
    Target(
        "ordinary_stack_cpu_ratio",
        "processor time of the baseline implementation over ours",
        (1, 4),
        at_least=True,
    ),
)
