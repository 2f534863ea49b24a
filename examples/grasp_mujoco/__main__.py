# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Command of the example: one grasp in words, reaction times over many, or a picture that moves."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from examples.grasp_mujoco.gripper import OBJECTS
from examples.grasp_mujoco.trial import Trial, grasp, seeded_task


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(prog="python -m examples.grasp_mujoco", description=__doc__)
    actions = parser.add_subparsers(dest="action", required=True)
    run = actions.add_parser("run", help="one grasp in simulated time")
    run.add_argument("--no-feedback", action="store_true", help="do not react to slip")
    run.add_argument("--for", dest="duration", type=float, default=1.9, help="duration [s]")
    reaction = actions.add_parser("reaction", help="reaction times over many grasps, as a table")
    reaction.add_argument("--grasps", type=int, default=20)
    reaction.add_argument("--processes", type=int, default=2)
    reaction.add_argument("--reported-slip-only", action="store_true", help="do not watch for creep")
    video = actions.add_parser("video", help="draw a grasp with and without feedback as an animated GIF")
    video.add_argument("--out", type=Path, default=Path("grasp.gif"))
    video.add_argument("--rate", type=float, default=12.0, help="frames per second of simulated time")
    ros = actions.add_parser("ros", help="the boards on emulated adapters, the whole stack, the controller as a node")
    ros.add_argument("--for", dest="duration", type=float, default=1.9, help="duration of the physics [s]")
    ros.add_argument("--no-feedback", action="store_true", help="do not react to slip")
    for action in (run, reaction, video, ros):
        action.add_argument("--object", choices=OBJECTS, help="default: sphere; of reaction: each in turn")
        action.add_argument("--seed", type=int, default=0)
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run a subcommand and return the exit code: 1 if the object was dropped."""
    options = make_parser().parse_args(words)
    if options.action == "reaction":
        from examples.grasp_mujoco.reaction import outcomes, table  # noqa: PLC0415

        seeds = range(options.seed, options.seed + options.grasps)
        print(table(outcomes(seeds, options.object, not options.reported_slip_only, options.processes)))
        return 0
    task = replace(seeded_task(options.seed, options.object or "sphere"), offset=0.0)
    if options.action == "video":
        from examples.grasp_mujoco.video import draw  # noqa: PLC0415  # needs matplotlib

        draw(task, options.out, options.rate, options.seed)
        print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")
        return 0
    if options.action == "ros":
        from examples.grasp_mujoco.ros_grasp import run as run_ros  # noqa: PLC0415  # needs ROS

        return run_ros(task, options.duration, options.seed, not options.no_feedback)
    trial = grasp(task, options.seed, not options.no_feedback, options.duration)
    print(summary(trial))
    return int(trial.dropped)


def summary(trial: Trial) -> str:
    """Return what happened in a grasp in some lines."""
    rows = trial.columns()
    time, grip, _, weight, least, height = rows[:6, -1]
    lines = [f"{trial.task.object}, friction {trial.task.friction:.2f}, weight up to {weight:.2f} N"]
    for slip, reaction in trial.reactions():
        answer = "no reaction" if math.isnan(reaction) else f"gripped harder after {reaction * 1e3:.1f} ms"
        lines.append(f"{slip:.4f} s  slips; {answer}")
    if trial.dropped:
        lines.append(f"{time:.3f} s  dropped, with a grip of {grip:.2f} N where {least:.2f} N are the least")
    else:
        lines.append(
            f"{time:.3f} s  held {height * 1e3:.1f} mm high with {grip:.2f} N, {grip / least:.2f} times the least force"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
