# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Draws a grasp with slip feedback beside one without as an animated GIF, from states; needs no graphics driver."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from PIL import Image

from examples.grasp_mujoco.controller import GripController
from examples.grasp_mujoco.fingertip import Fingertip
from examples.grasp_mujoco.gripper import FACE, HALF_HEIGHTS, Gripper, Task
from examples.grasp_mujoco.trial import Trial, grasp

PLAYED = 7.0
"""Frames per second when the GIF is played."""
SIZE = (7.2, 4.5)
DOTS = 100
COLOURS = 48
"""Colours of the GIF."""
MOST_FORCE = 0.12
"""Force on a taxel at the end of the colour scale [N]."""


@dataclass(frozen=True)
class Frame:
    """What is drawn of one time."""

    time: float
    hand: float
    """Height of the middle of the fingertips [m]."""
    gap: float
    """Distance of the fingertips [m]."""
    object: float
    """Height of the object's middle [m]."""
    pull: float
    images: tuple[np.ndarray, np.ndarray]
    """Force on each taxel of both fingertips as estimated [N], shape [rows, cols]."""


def record(task: Task, feedback: bool, rate: float, seed: int, duration: float) -> tuple[Trial, list[Frame]]:
    """Run a grasp and return it with frames at a rate [Hz] of simulated time."""
    frames: list[Frame] = []

    def watch(gripper: Gripper, fingertips: tuple[Fingertip, Fingertip], controller: GripController) -> None:
        if gripper.time >= len(frames) / rate:
            images = tuple(np.nan_to_num(tip.forces()) for tip in fingertips)
            hand, held = (float(gripper.data.body(name).xpos[2]) for name in ("hand", "object"))
            frames.append(Frame(gripper.time, hand, gripper.finger_gap(), held, gripper.pull, images))

    return grasp(task, seed, feedback, duration, watch=watch), frames


def draw(task: Task, out: Path, rate: float, seed: int = 0, duration: float = 1.9) -> None:
    """Write the GIF.

    Parameters
    ----------
    task : Task
        What is grasped.
    out : Path
        File to write.
    rate : float
        Frames per second of simulated time.
    seed : int
        Seed of the boards.
    duration : float
        Duration of the grasp [s].
    """
    runs = [record(task, feedback, rate, seed, duration) for feedback in (True, False)]
    count = max(len(frames) for _, frames in runs)
    with mpl.rc_context({"font.size": 7}):
        pictures = [_picture(runs, index) for index in range(count)]
    palette = pictures[len(pictures) * 3 // 4].quantize(COLOURS)
    first, *others = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    first.save(out, save_all=True, append_images=others, duration=round(1000 / PLAYED), loop=0, optimize=True)


def described(frame: Frame) -> str:
    """Return time, pull of the weight and force on the left fingertip in words."""
    felt = round(float(frame.images[0].sum()), 2) + 0.0  # no -0.00
    return f"{frame.time:.2f} s\npull {frame.pull:.2f} N\nfelt {felt:.2f} N"


def _picture(runs: list[tuple[Trial, list[Frame]]], index: int) -> Image.Image:
    figure = Figure(figsize=SIZE, dpi=DOTS)
    grid = figure.add_gridspec(
        3,
        7,
        width_ratios=(1, 1, 1, 0.35, 1, 1, 1),
        height_ratios=(2.9, 0.9, 1.4),
        left=0.065,
        right=0.99,
        bottom=0.09,
        top=0.95,
        hspace=0.35,
    )
    for column, (trial, frames) in enumerate(runs):
        frame = frames[min(index, len(frames) - 1)]
        over = index >= len(frames) and trial.dropped
        begin = 4 * column  # one column of the grid is the gap between the runs
        columns = slice(begin, begin + 3)
        _scene(figure.add_subplot(grid[0, columns]), trial, frame, over)
        for side, image in enumerate(frame.images):
            axes = figure.add_subplot(grid[1, begin + 2 * side])
            axes.imshow(image, origin="lower", cmap="viridis", vmin=0.0, vmax=MOST_FORCE)
            axes.set(xticks=[], yticks=[], xlabel=("left", "right")[side])
        label = figure.add_subplot(grid[1, begin + 1])
        label.axis("off")
        label.text(0.5, 0.5, described(frame), ha="center", va="center")
        _strip(figure.add_subplot(grid[2, columns]), trial, frame.time)
    canvas = FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    canvas.print_png(buffer)
    return Image.open(buffer).convert("RGB")


def _scene(axes: Axes, trial: Trial, frame: Frame, dropped: bool) -> None:
    """Draw gripper, object and weight from the front [mm]."""
    axes.set(xlim=(-40, 40), ylim=(-12, 42), aspect="equal", xticks=[], yticks=[])
    axes.set_title("with slip feedback" if trial.feedback else "without slip feedback", fontsize=8)
    axes.add_patch(Rectangle((-3, -12), 6, 12, color="0.75"))
    hand, half, face = frame.hand * 1e3, frame.gap * 500, FACE * 1e3
    for side in (-1, 1):
        axes.add_patch(Rectangle((side * half - (6 if side < 0 else 0), hand - face), 6, 2 * face, color="tab:gray"))
        axes.add_patch(Rectangle((side * half - (0.8 if side < 0 else 0), hand - 3.75), 0.8, 7.5, color="tab:green"))
    middle = HALF_HEIGHTS[trial.task.object] * 1e3 if dropped else frame.object * 1e3
    if dropped:
        axes.text(22, 15, "dropped", color="tab:red", ha="center", fontsize=9, weight="bold")
    for patch in _object(trial.task.object, middle):
        axes.add_patch(patch)
    if frame.pull > 0 and not dropped:
        size, bottom = 3 + 8 * frame.pull, middle - HALF_HEIGHTS[trial.task.object] * 1e3
        axes.plot([0, 0], [bottom - 4, bottom], color="0.3", lw=0.8)
        axes.add_patch(Rectangle((-size / 2, bottom - 4 - size), size, size, color="tab:brown"))


def _object(kind: str, middle: float) -> list[Circle | Rectangle]:
    """Return the shape of an object at a height of its middle [mm]."""
    if kind in {"sphere", "soft"}:
        return [Circle((0, middle), 8 if kind == "sphere" else 9, color="tab:orange")]
    if kind == "box":
        return [Rectangle((-8, middle - 2.5), 16, 5, color="tab:orange")]
    ribs = [Circle((side * 7, middle + 4 * row), 1, color="tab:orange") for side in (-1, 1) for row in range(-3, 4)]
    return [Rectangle((-6.5, middle - 13), 13, 26, color="tab:orange"), *ribs]


def _strip(axes: Axes, trial: Trial, time: float) -> None:
    """Draw grip force, least grip force and slips up to a time [s]."""
    rows = trial.columns()
    end = np.searchsorted(rows[0], time)
    axes.plot(rows[0, :end], rows[1, :end], color="tab:blue", lw=1.2, label="grip command")
    axes.plot(rows[0, :end], rows[4, :end], color="tab:red", lw=1.0, ls="--", label="least grip for the weight")
    for slip in trial.slips:
        if slip <= time:
            axes.axvline(slip, color="tab:orange", lw=0.8)
    axes.plot([], [], color="tab:orange", lw=0.8, label="slip begins")
    axes.set(xlim=(0, 1.9), ylim=(0, 1.8), xlabel="time [s]", ylabel="N")
    axes.legend(loc="upper left", frameon=False, fontsize=6)
