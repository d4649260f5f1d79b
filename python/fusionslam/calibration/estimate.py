# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One quantity that a calibration estimates, or the motion that it lacks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval.

    Attributes:
        name: of the quantity, such as "lidar_from_imu.roll".
        value: the number found; None if it cannot be said.
        unit: of the value, the half width and ``now``: "deg", "m" or "ms".
        half_width: the interval is value - half_width to value + half_width; None if it cannot
            be said.
        missing: the motion that is missing, in words with numbers; None if there is a value.
        now: the value that the recording states; None if it states none.
    """

    name: str
    value: float | None
    unit: str
    half_width: float | None
    missing: str | None = None
    now: float | None = None

    @property
    def differs(self) -> bool | None:
        """Whether the recording's value is outside of the interval; None if one is unknown."""
        if self.value is None or self.half_width is None or self.now is None:
            return None
        return abs(self.value - self.now) > self.half_width

    def row(self) -> tuple[str, str, str, str]:
        """Cells of a table: quantity, value now, value found, and what that says."""
        label = f"{self.name} [{self.unit}]"
        now = "" if self.now is None else f"{self.now:.4g}"
        if self.value is None:
            return label, now, "cannot say", self.missing or ""
        found = f"{self.value:.4g} +- {self.half_width:.2g}"
        says = {None: "", False: "agrees", True: "DIFFERS"}[self.differs]
        return label, now, found, says
