"""Finds cars in an image of class numbers.

It stands in for a detector of yours: the simulator labels every pixel, so that its boxes are exact.
"""

from __future__ import annotations

from typing import Any

import gantry
import numpy as np
import numpy.typing as npt

CAR = gantry.CLASS_NAMES.index("Car")
#: Narrower groups of columns are no car, pixels.
MIN_WIDTH_PX = 4


def cars(classes: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """Returns a box round each group of neighbouring columns with pixels of cars.

    `classes` is (h, w). Cars that cover one another share a box.
    """
    is_car = classes == CAR
    columns = np.flatnonzero(is_car.any(axis=0))
    corners = []
    for group in np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1):
        if len(group) >= MIN_WIDTH_PX:
            rows = np.flatnonzero(is_car[:, group].any(axis=1))
            corners.append((group[0], rows[0], group[-1] + 1, rows[-1] + 1))
    boxes = np.array(corners, float).reshape(-1, 4)
    return gantry.boxes2d(boxes[:, :2], boxes[:, 2:], class_=CAR)
