# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A fingertip: contacts of the engine, simulated board, CAN emulation, the driver's decoder and the model in a row."""

from __future__ import annotations

import mujoco
import numpy as np

from examples.grasp_mujoco.controller import Touch
from examples.grasp_mujoco.gripper import EFFECTIVE_MODULI, Gripper
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import ContactThresholds, Sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.lockstep import LockstepBoard
from posfet_sim.physics.mujoco_loads import MujocoLoads

THRESHOLDS = ContactThresholds(threshold=0.010, deadband=0.005)
"""Contact and release threshold [N]: half of the shipped ones, so that a wide face is felt at a small grip force."""


def fingertip_loads(gripper: Gripper, name: str, sensor: Sensor, advance=None) -> MujocoLoads:
    """Return the loads of the fingertip `name` of the gripper; `advance` as for `MujocoLoads`."""
    model = gripper.model
    touched = [model.geom(number).name for number in range(model.ngeom) if model.geom_bodyid[number] == _object(model)]
    modulus = EFFECTIVE_MODULI[gripper.task.object]
    return MujocoLoads(sensor, model, gripper.data, name, [name], dict.fromkeys(touched, modulus), advance)


def _object(model: mujoco.MjModel) -> int:
    return int(model.body("object").id)


class Fingertip:
    """One fingertip, scan by scan.

    Parameters
    ----------
    gripper : Gripper
        The physics.
    name : str
        'left' or 'right'.
    sensor : Sensor
        Sensor description.
    seed : int
        Seed of the board.
    error_model : ErrorModel
        Non-idealities of the board.
    """

    def __init__(self, gripper: Gripper, name: str, sensor: Sensor, seed: int, error_model: ErrorModel) -> None:

        def advance(time: float) -> None:
            gripper.advance(time)
            self.loads.read()

        self.loads = fingertip_loads(gripper, name, sensor, advance)
        """Loads on the board, whose clock is not quite that of the physics: it asks for what it needs."""
        self.board = LockstepBoard(sensor, self.loads, seed, error_model)
        """The board on its emulated bus."""
        self._model = Reconstructor(sensor, settings=ReconstructionSettings(contact=THRESHOLDS))
        self.touch = Touch()
        """What it felt in the newest scan."""

    def scan(self) -> Touch:
        """Take the next scan through board, bus, decoder and model; the board steps the engine as far as it needs."""
        scan = self.board.next_scan()
        if scan is not None:
            result = self._model.process(scan)
            self.touch = touch_of(result, self.forces())
            self._model.run_maintenance()
        return self.touch

    def forces(self) -> np.ndarray:
        """Return the force on each taxel as the model estimates it [N], shape [rows, cols]."""
        layout = self.board.board.sensor.layout
        return self._model.image().force.reshape(layout.rows, layout.cols).copy()


def touch_of(result: Reconstruction, forces: np.ndarray) -> Touch:
    """Return what the controller takes of a scan.

    Parameters
    ----------
    result : Reconstruction
        Contacts of the scan.
    forces : array of shape [rows, cols]
        Force on each taxel [N].
    """
    contacts = [each for each in result.contacts if each.state is not ContactState.RELEASED]
    force = sum(each.region.force for each in contacts)
    if force <= 0:
        return Touch(valid=result.valid)
    return Touch(force, forces, any(each.slipping for each in result.motions.values()), result.valid)
