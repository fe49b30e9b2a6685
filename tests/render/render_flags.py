"""Flags that the tests of the renderer draw."""

import numpy as np

BOUNDS = np.array([[-1.2, -1.3, -1.3], [2.3, 1.3, 1.5]])
MAST = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def lattice(layers: int = 1, rows: int = 10, cols: int = 16, wave: float = 0.15) -> np.ndarray:
    """Return a flag of 1.5 m x 1.0 m, shape (layers, rows, cols, 3), that waves by `wave` [m]."""
    layer, row, col = np.meshgrid(np.arange(layers), np.arange(rows), np.arange(cols), indexing="ij")
    x, z = 1.5 * col / max(cols - 1, 1), row / max(rows - 1, 1)
    return np.stack([x, wave * np.sin(4.0 * x) * x + 0.1 * layer, z], axis=-1)
