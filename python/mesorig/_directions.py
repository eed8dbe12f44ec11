"""Directions in the frame of the sample."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True)
class Directions:
    """n directions that point away from the surface.

    theta_deg (n) is the angle from the normal. phi_deg (n) is counted from +x, counter-clockwise.
    """

    theta_deg: NDArray[np.float64]
    phi_deg: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.theta_deg)

    @property
    def vectors(self) -> NDArray[np.float64]:
        """Unit vectors, n × 3. x is along the rows, y against the columns, z is the normal."""
        theta, phi = np.radians(self.theta_deg), np.radians(self.phi_deg)
        return np.stack(
            [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
        )
