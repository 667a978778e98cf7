"""NumPy archives that are written whole or not at all."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np


def write(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """
    Write arrays by name, compressed; replaces the file whole.

    :param path: ending in ``.npz``
    """
    partial = path.with_name(f'.{path.stem}.partial.npz')
    np.savez_compressed(partial, **arrays)  # type: ignore[arg-type]
    partial.replace(path)
