"""The message of /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from posfet_model._lib.units import NANOSECONDS


def diagnostic_array(
    level: int, name: str, text: str, hardware_id: str, values: Mapping[str, str], stamp: int
) -> DiagnosticArray:
    """Return a message with one status.

    Parameters
    ----------
    level : int
        Level of diagnostic_msgs/DiagnosticStatus.
    name : str
        Name of the status.
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
        level=bytes([level]),
        name=name,
        message=text,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
    return message
