# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Services of the model node: tare, and calibrations that are loaded and saved."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any, Final

from rclpy.node import Node

from posfet_model.calibration.calibration_folder import CalibrationFolder
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.reconstruction.reconstructor import Reconstructor, Tare
from posfet_msgs.srv import CalibrationFile
from posfet_msgs.srv import Tare as TareService

NOT_CONFIGURED = "the model is not configured"
"""Answer of services that need the transition configure first."""


class ModelServices:
    """`tare`, `calibration/load` and `calibration/save`.

    Parameters
    ----------
    node : Node
        Node that serves.
    folder : CalibrationFolder
        Where calibrations are.
    model : callable
        Returns the reconstructor in use, None while the node is not configured.
    use : callable
        Begins to estimate with a calibration, and returns the new reconstructor.
    tare : callable
        Sets the forces to zero, in any case if its argument is true; None while the node is not active.
    """

    def __init__(
        self,
        node: Node,
        folder: CalibrationFolder,
        model: Callable[[], Reconstructor | None],
        use: Callable[[Calibration], Reconstructor],
        tare: Callable[[bool], Tare | None],
    ) -> None:
        self._folder, self._model, self._use, self._tare = folder, model, use, tare
        self.folder_problem: Final = folder.problem
        """Why `calibration/save` cannot write, in one line, as found at the start; '' if it can."""
        if self.folder_problem:
            node.get_logger().warning(f"{self.folder_problem}: calibration/save will be refused")
        node.create_service(TareService, "tare", self._set_to_zero)
        node.create_service(CalibrationFile, "calibration/load", self._load)
        node.create_service(CalibrationFile, "calibration/save", self._save)

    def _set_to_zero(self, request: Any, response: Any) -> Any:
        tare = self._tare(request.force)
        if tare is None:
            response.message = "refused: the model is not active"
            return response
        response.success, response.message = tare.done, tare.message
        response.force_change = array("f", tare.force_change.tolist())
        return response

    def _load(self, request: Any, response: Any) -> Any:
        if self._model() is None:
            response.message = NOT_CONFIGURED
            return response
        try:
            calibration = self._folder.load(request.path)
        except ConfigError as error:
            response.success, response.message = False, str(error)
            return response
        date = self._use(calibration).calibration.date or "no date"
        response.success, response.message = True, f"calibration of {date} in use; baselines are estimated again"
        return response

    def _save(self, request: Any, response: Any) -> Any:
        model = self._model()
        if model is None:
            response.message = NOT_CONFIGURED
            return response
        try:
            path = self._folder.save(request.path, model.calibration)
        except ConfigError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"{path}: written"
        return response
