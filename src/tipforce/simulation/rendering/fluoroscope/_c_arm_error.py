"""Calibration errors of a C-arm: the stated one differs from the true one."""

import numpy as np

from ....geometry import CArm


def perturbed(true: CArm, rms_px: float, rng: np.random.Generator, *, reach_m: float = 40e-3) -> CArm:
    """Adds calibration errors to all numbers of a C-arm.

    Args:
        true: the true C-arm.
        rms_px: RMS shift of the corners and the middle of a cube around the isocentre, in an image of 512 columns.
        rng: random numbers of the errors.
        reach_m: half the edge of this cube.

    Returns:
        The C-arm as calibrated.
    """
    cube_m = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]) * reach_m
    true_px = true.camera().project(cube_m)
    primary, secondary, roll = (float(d) for d in rng.normal(size=3) * (0.1, 0.1, 0.05))  # degrees
    detector, source = (float(d) for d in rng.normal(size=2) * (2e-3, 1e-3))  # m
    right, down = (float(d) for d in rng.normal(size=2) * 0.4)  # px

    def moved(size: float) -> CArm:
        """Returns the C-arm with ``size`` times the drawn errors."""
        far, near = true.source_detector_m + size * detector, true.source_object_m + size * source
        return CArm(
            true.primary_deg + size * primary,
            true.secondary_deg + size * secondary,
            far,
            near,
            # The detector's own pitch is known: wrong distances give a wrong scale at the isocentre.
            true.imager_spacing_m() * near / far,
            true.roll_deg + size * roll,
            (true.centre_px[0] + size * right, true.centre_px[1] + size * down),
        )

    size = 1.0
    for _ in range(4):  # the shift of the points is nearly linear in the size
        shift_px = moved(size).camera().project(cube_m) - true_px
        size *= rms_px / float(np.sqrt((shift_px**2).sum(axis=1).mean()))
    return moved(size)
