"""Calibrate the camera, see how well that is known, and watch for drift afterwards.

Run: python examples/12_calibrate.py [OBSERVATIONS]
"""

import sys

from debrisgrasp import api
from debrisgrasp.calibration import DriftMonitor
from debrisgrasp.io import data_path


def main() -> None:
    bundled = data_path("calibration", "roman_looks.yaml")
    path = sys.argv[1] if len(sys.argv) > 1 else bundled
    found = api.calibrate(path)

    print(f"{found.decision}, by the model {found.model!r}")
    for note in found.decision.notes:
        print(f"  {note}")
    print(f"a point of the workspace will be off by {1e3 * found.error.rms:.1f} mm,")
    print(f"  at its worst corner by {1e3 * found.error.worst:.1f} mm;")
    print(f"  the residual, {1e3 * found.rmse:.1f} mm, tells about the noise only")
    x, y, z = found.T_base_camera.p
    print(f"the camera is at x {x:.3f}, y {y:.3f}, z {z:.3f} m")

    # Weeks later: the hand is seen after every task, and the joints of the head count.
    looks = api.looks(data_path("calibration", "roman_later.yaml"))
    monitor = DriftMonitor(calibration=found)
    for i in range(len(looks)):
        monitor, report = monitor.seen(looks.selected([i]))
        print(f"look {i + 1}: {report}")


if __name__ == "__main__":
    main()
