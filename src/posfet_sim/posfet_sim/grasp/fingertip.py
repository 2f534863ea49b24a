# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A simulated fingertip: a board under the loads of a grasp, and the model that reads it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.physics.engine_loads import EngineContact, EngineLoads


class Fingertip:
    """A board with its loads and its model, scan by scan.

    Parameters
    ----------
    sensor : Sensor
        Sensor description; flat.
    seed : int
        Seed of everything random on the board.
    error_model : ErrorModel
        Sensor error model.
    """

    def __init__(self, sensor: Sensor, seed: int, error_model: ErrorModel) -> None:
        self.loads = EngineLoads(sensor, name="grasp")
        """Loads on the board."""
        self.board = SimulatedBoard(sensor, self.loads, seed, error_model)
        """The board, with its ground truth."""
        self.model = Reconstructor(sensor)
        """The model."""
        self._scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self._shape = sensor.layout.rows, sensor.layout.cols

    def scan(self, contacts: Sequence[EngineContact]) -> Reconstruction:
        """Return the result of the next scan, which the one after it overwrites.

        Parameters
        ----------
        contacts : sequence of EngineContact
            What touches at the time of the scan.
        """
        index = self.board.index + 1
        self.loads.push(max(self.board.clock.time(index), self.loads.time), contacts)
        self.board.scan(index, self._scan)
        if self.model.maintenance_due:
            self.model.run_maintenance()
        return self.model.process(self._scan)

    def force(self) -> NDArray[np.float32]:
        """Return the force on each taxel [N], shape [rows, cols]; NaN: unknown. A copy."""
        force: NDArray[np.float32] = self.model.image().force.reshape(self._shape).copy()
        return force
