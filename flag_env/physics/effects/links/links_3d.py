"""Links in three coordinates: what a link of each kind pulls; `chunks_3d` has the loops over them."""

from __future__ import annotations

import numpy as np

from flag_env.physics.effects.links.back import axial_back, axial_slopes, by_both, by_stiffness, elastic_slopes
from flag_env.physics.effects.links.back_3d import elastic_back, isotropic_back, isotropic_slopes_3d
from flag_env.physics.effects.links.chunks_3d import forces_3d
from flag_env.physics.effects.links.kernels import Dampers, Springs


class Elastic3(Springs):
    """Springs alone."""

    force = staticmethod(forces_3d)
    pull_back = staticmethod(elastic_back)
    slopes = staticmethod(elastic_slopes)
    parameters = staticmethod(by_stiffness)

    @staticmethod
    def pull(data, dx, dy, dz, du, dv, dw, weight, tension):
        """See `_pull`."""
        s = weight * (data.stiffness - tension / np.sqrt(dx * dx + dy * dy + dz * dz + data.tiny))
        return s * dx, s * dy, s * dz


class Isotropic3(Dampers):
    """Springs with isotropic dampers."""

    force = staticmethod(forces_3d)
    pull_back = staticmethod(isotropic_back)
    slopes = staticmethod(isotropic_slopes_3d)
    parameters = staticmethod(by_both)

    @staticmethod
    def pull(data, dx, dy, dz, du, dv, dw, weight, tension):
        """See `_pull`."""
        s = weight * (data.stiffness - tension / np.sqrt(dx * dx + dy * dy + dz * dz + data.tiny))
        b = weight * data.viscosity
        return s * dx + b * du, s * dy + b * dv, s * dz + b * dw


class Axial3(Dampers):
    """Springs with axial dampers."""

    force = staticmethod(forces_3d)
    pull_back = staticmethod(axial_back)
    slopes = staticmethod(axial_slopes)
    parameters = staticmethod(by_both)

    @staticmethod
    def pull(data, dx, dy, dz, du, dv, dw, weight, tension):
        """See `_pull`."""
        d2 = dx * dx + dy * dy + dz * dz + data.tiny
        rate = dx * du + dy * dv + dz * dw
        s = weight * (data.stiffness - tension / np.sqrt(d2) + data.viscosity * rate / d2)
        return s * dx, s * dy, s * dz
