# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The message of /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor

_ERROR = 2


def hardware_id(sensor: Sensor, namespace: str) -> str:
    """Return what tells this board from all others: its serial number, or its name and namespace if it has none.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    namespace : str
        Full namespace of the nodes.
    """
    return sensor.serial or f"{sensor.name} ({namespace.strip('/')})"


def diagnostic_array(
    level: int, name: str, text: str, hardware_id: str, values: Mapping[str, str], stamp: int
) -> DiagnosticArray:
    """Return a message with one status.

    Parameters
    ----------
    level : int
        Level of diagnostic_msgs/DiagnosticStatus; STALE becomes ERROR, since only an aggregator knows what is stale.
    name : str
        Name of the status; a slash at the front is left out.
    text : str
        Message of the status.
    hardware_id : str
        Hardware that it is about.
    values : mapping of str to str
        Keys and values.
    stamp : int
        Time since the Unix epoch [ns].

    Returns
    -------
    DiagnosticArray
        The message.
    """
    status = DiagnosticStatus(
        level=bytes([min(level, _ERROR)]),
        name=name.lstrip("/"),
        message=text,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
    return message
