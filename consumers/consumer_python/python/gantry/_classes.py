"""Semantic classes: CARLA's numbers with names and colours."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ._layout import CLASSES

#: Names; the index is the class number.
CLASS_NAMES: list[str] = [name for name, _ in CLASSES]
#: sRGB colours, shape (256, 3); numbers without a name are black.
CLASS_COLOURS: npt.NDArray[np.uint8] = np.zeros((256, 3), dtype=np.uint8)
CLASS_COLOURS[: len(CLASSES)] = [colour for _, colour in CLASSES]


def colour_classes(classes: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Turns class numbers of any shape into sRGB uint8: (h, w) becomes (h, w, 3)."""
    coloured: npt.NDArray[np.uint8] = CLASS_COLOURS[np.asarray(classes)]
    return coloured
