# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Cost of one object in a scan, for each kind on a small and a large array: the table of docs/scenes.md.

Run: python -m benchmarks.simulation.scene_cost
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.contact.indenters import FlatIndenter, Shape, Sphere
from posfet_sim.contact.line_contacts import Cylinder, Edge
from posfet_sim.contact.rectangular_indenter import RectangularIndenter
from posfet_sim.contact.textured_pads import Ridges, Roughness
from posfet_sim.scene import ChipBend, Keyframes, Scene, SceneLoads, SceneObject
from posfet_sim.scene.trajectories import Vibration

SCANS = 96
BATCH = 16
"""Scans that a large board computes in one batch."""
REPEATS = 30
SHAPES: dict[str, Shape] = {
    "sphere": Sphere(5e-3, 2e6),
    "punch": FlatIndenter(1.5e-3, 2e6),
    "punch, rectangular": RectangularIndenter(4e-3, 2e-3, 2e6),
    "cylinder": Cylinder(4e-3, 2e6, 3e-3),
    "edge": Edge(4e-3, 2e6, math.tan(math.radians(20))),
    "texture, 3 ridges": Ridges(6e-3, 4e-3, 3, 10e-6, 2e6),
    "texture, 60 bumps": Roughness(6e-3, 4e-3, 60, 1),
}


def cost(sensor: Sensor, shape: Shape, angle: float, bend: ChipBend | None) -> tuple[float, int]:
    """Return the minimum time per scan [us], and the number of loaded taxels, while the force changes."""
    path = Vibration(0.0, 10.0, 1.0, 0.3e-3, -0.2e-3, angle, 1.0, 0.2, 37.0, 37.0)
    temperature = Keyframes((0.0,), ((25.0,),))
    scene = Scene("cost", "-", math.inf, (SceneObject("object", shape, path),), temperature, bend)
    loads = SceneLoads(scene, sensor)
    times = [1.0 + index * 1e-3 for index in range(SCANS)]
    minimum = math.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        for first in range(0, SCANS, BATCH):
            loads.forces(times[first : first + BATCH])
        minimum = min(minimum, time.process_time() - begin)
    return minimum / SCANS * 1e6, loads.forces([1.0])[0].force.size


def main() -> None:
    """Print the table."""
    small = load_sensor()
    large = replace(small, layout=replace(small.layout, rows=64, cols=64))
    cases = [(small, 0.0, None), (large, 0.0, None), (large, 0.5, None), (large, 0.5, ChipBend(20e-3, axis_x=False))]
    print("| kind | 5 x 5 | 64 x 64 | rotated by 29 deg | rotated, bent chip | taxels within reach of 4096 |")
    print("|---|---|---|---|---|---|")
    for name, shape in SHAPES.items():
        costs = [cost(sensor, shape, angle, bend) for sensor, angle, bend in cases]
        cells = [f"{each:.0f} us" for each, _ in costs]
        if isinstance(shape, RectangularIndenter):
            cells[3] = "-"  # not on a bent chip
        print(f"| {name} | {' | '.join(cells)} | {costs[2][1]} |")


if __name__ == "__main__":
    main()
