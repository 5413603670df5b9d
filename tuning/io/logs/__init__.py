"""Recorded drives as robots record them: bags of ROS 1 and 2, MCAP, ULog of PX4, dataflash of ArduPilot, MDF.

`read` makes a `Recording` of any of them; `roles.candidates` says what its streams can serve as, and `rows.table` lays
the chosen ones side by side.
"""

from .read import READERS, is_recording, read
from .recording import Recording, Stream

__all__ = ["READERS", "Recording", "Stream", "is_recording", "read"]
