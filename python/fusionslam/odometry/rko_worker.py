# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""RKO-LIO in a process of its own, as it writes to standard output.

Started by ``inertial_matcher``; its argument is the descriptor of a connection. It says None, or
why RKO-LIO cannot be loaded. It is sent settings, then of each scan the messages of the IMU since
the one before, the points and their times. It answers with the pose, or why there is none.
"""

import os
import sys
from contextlib import suppress
from multiprocessing.connection import Connection


def main(descriptor: int) -> None:
    """Answer until the connection ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    with Connection(descriptor) as line:
        try:
            from rko_lio.config import LIOConfig
            from rko_lio.lio import LIO
            from rko_lio.rko_lio_pybind import InputError, RegistrationError
        except ImportError as error:
            line.send(str(error))
            return
        line.send(None)
        odometry = LIO(LIOConfig(**line.recv()))
        while True:
            felt, base_from_imu, points, times_ns, base_from_scan = line.recv()
            for time_ns, linear, angular in felt:
                odometry.add_imu_measurement(linear, angular, time_ns, base_from_imu)
            try:
                odometry.register_scan(points, times_ns, base_from_scan)
            except (InputError, RegistrationError) as error:
                line.send(str(error))
            else:
                line.send(odometry.pose())


if __name__ == "__main__":
    with suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        main(int(sys.argv[1]))
