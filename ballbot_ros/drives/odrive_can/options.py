# SPDX-License-Identifier: Apache-2.0
"""The options of a driver of an ODrive on a CAN bus."""
from dataclasses import dataclass
from typing import Mapping, Optional

from ballbot_ros.config.fields import count, quantity, section, text
from ballbot_ros.drives.contract import DriveOptions
from ballbot_ros.drives.odrive_can.codec import HIGHEST_NODE
from ballbot_ros.drives.odrive_can.settings import check_confirmed
from ballbot_ros.errors import ConfigurationError

# First firmware 0.5 whose heartbeat tells whether the encoder failed.
FIRST = (0, 5, 3)


@dataclass(frozen=True)
class ODriveCanOptions(DriveOptions):
    """See the fields; which firmware needs which is in docs/hardware.md."""

    node_id: int = count('node id of the axis on the bus', default=0, maximum=HIGHEST_NODE)
    status_period: float = quantity(
        's', 'time between requests for currents, voltage, temperatures and error registers, of '
        'which one is asked at a time', default=0.02, minimum=0.0, maximum=1.0)
    firmware: str = text(
        'version of a firmware 0.5, such as "0.5.6", which does not tell it over CAN', default='')
    endpoints: str = text(
        'path of flat_endpoints.json, which the maker has for each firmware 0.6: by it settings '
        'are read over CAN', default='')
    confirmed: Optional[Mapping[str, float]] = section(
        'values of properties that a person has read with odrivetool, by name, where a firmware '
        '0.5 does not tell them over CAN', default=None)

    def __post_init__(self) -> None:
        """Check, also what is confirmed."""
        super().__post_init__()
        check_confirmed(self.confirmed)
        if self.firmware and not self.version:
            raise ConfigurationError(
                'firmware must be the version of a firmware 0.5 from 0.5.3 on, such as "0.5.6", '
                f'got {self.firmware!r}')

    @property
    def version(self) -> tuple[int, ...]:
        """Return the version of the firmware, empty if it is not given, or cannot be used."""
        parts = self.firmware.split('.')
        numbers = tuple(int(part) for part in parts if part.isdigit())
        known = len(numbers) == len(parts) == 3 and FIRST <= numbers and numbers[:2] == FIRST[:2]
        return numbers if known else ()
