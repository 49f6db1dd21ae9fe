"""Calibrations of cameras: which pixel shows a direction, and which direction a pixel."""

from __future__ import annotations

import json
import threading
import time
from typing import Any, Callable

import numpy as np
import numpy.typing as npt

from ._errors import FrameFormatError, GantryError
from ._load import native

#: Seconds between two looks for a camera that `world/info` does not describe yet.
_LOOK_SECS = 0.02
#: Seconds after which a camera is not waited for any more: `world/info` is sent in the tick that makes it.
_LOOK_FOR_SECS = 2.0
#: Keys of `world/info` that every calibration has besides those of its lens.
_OF_ALL = ("focal_px", "shear_px", "centre_px", "max_angle_rad")


class Calibration:
    """What a camera's pixels show: `frame.calibration`.

    Points and directions are in the camera's optical axes (x to the right, y down, z ahead), as in
    files of calibration. The middle of the top-left pixel is (0.5, 0.5): files of OpenCV, Kalibr
    and ROS count from there, so 0.5 is subtracted for them. All numbers are float64, and the models
    are the simulator's own.
    """

    __slots__ = ("_crc", "_facts", "_own")

    def __init__(self, own: native.Calibration, crc: int) -> None:
        self._own, self._crc = own, crc
        self._facts: dict[str, Any] = json.loads(own.text())

    @property
    def model(self) -> str:
        """Name of the lens's model, as in launch files; `carla` for a pinhole whose image `header.lens` bends."""
        return "carla" if "distortion" in self._facts else str(self._facts["lens"]["model"])

    @property
    def parameters(self) -> dict[str, Any]:
        """The lens's numbers by the names of the launch file: `focal_px`, `centre_px`, `coefficients`, …

        `max_angle_rad` is the angle to the axis at which the field ends. `distortion` of the model
        `carla` is the header's `lens`.
        """
        own = {key: value for key, value in self._facts["lens"].items() if key != "model"}
        bent = {"distortion": self._facts["distortion"]} if "distortion" in self._facts else {}
        return {**{key: self._facts[key] for key in _OF_ALL}, **own, **bent}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images, pixels."""
        width, height = self._facts["size_px"]
        return width, height

    @property
    def crc(self) -> int:
        """`calibration_crc` of the headers, which tells one lens from another; 0 of a camera whose header says all."""
        return self._crc

    def project(self, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Returns the pixels (2,) or (n, 2) that show points (3,) or (n, 3); NaN for what the lens does not see.

        Pixels may lie beside the image. `frame.calibration.project(points)` of points on the camera's
        own axes; those of the world are brought there by `header.world_from_sensor.inverse()` and a turn.
        """
        return _each(points, 3, "points", self._own.project, 2)

    def unproject(self, pixels: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Returns the directions (3,) or (n, 3), of length 1, that pixels (2,) or (n, 2) show; NaN where there is none."""
        return _each(pixels, 2, "pixels", self._own.unproject, 3)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Calibration) and (self._crc, self._facts) == (other._crc, other._facts)

    def __hash__(self) -> int:
        return hash((self._crc, self.model, self.size))

    def __repr__(self) -> str:
        width, height = self.size
        return f"<gantry.Calibration {self.model} {width}×{height} crc={self._crc:#010x}>"


def _each(
    given: npt.ArrayLike, n: int, what: str, act: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]], n_out: int
) -> npt.NDArray[np.float64]:
    numbers = np.ascontiguousarray(given, np.float64)
    if numbers.ndim not in (1, 2) or numbers.shape[-1] != n:
        raise ValueError(f"{what} have the shape {np.shape(given)}; it must be ({n},) or (n, {n})")
    found: npt.NDArray[np.float64] = act(numbers.reshape(-1)).reshape(*numbers.shape[:-1], n_out)
    return found


def of_camera(described: dict[str, Any]) -> Calibration | None:
    """Makes the calibration of a camera of `world/info`; None if it is of a model that this version does not know."""
    facts = described["calibration"]
    numbers: list[float] = []
    for key, value in facts["lens"].items():
        if key == "direction":
            numbers.append(float(value == "angle_to_distance"))
        elif key != "model":
            numbers += value if isinstance(value, list) else [value]
    try:
        own = native.Calibration(
            facts["size_px"],
            facts["lens"]["model"],
            numbers,
            focal_px=facts["focal_px"],
            shear_px=facts.get("shear_px", [0.0, 0.0]),
            centre_px=facts["centre_px"],
            max_angle_rad=facts["max_angle_rad"],
            distortion=facts.get("distortion", [0.0] * 4),
        )
    except (ValueError, TypeError):
        return None
    # What it names is exactly these numbers.
    return Calibration(own, facts["crc"]) if facts["crc"] in (0, own.crc) else None


#: Lenses with a model that frames have been asked for, by `calibration_crc`.
_known: dict[int, Calibration] = {}
_lock = threading.Lock()
#: Lenses that are kept.
_MOST_KNOWN = 4096


def take(info: str) -> None:
    """Keeps the lenses that a text of `world/info` describes."""
    for camera in json.loads(info).get("cameras", []):
        found = of_camera(camera)
        if found is not None and found.crc:
            with _lock:
                if len(_known) >= _MOST_KNOWN:
                    _known.clear()
                _known[found.crc] = found


def of_header(header: bytes, lens_model: int, crc: int, look: Callable[[], str | None] | None) -> Calibration:
    """Returns the calibration that a header names. `look` is where to find the text of `world/info`.

    Raises `FrameFormatError` for a frame that has none, `GantryError` if its lens is described nowhere.
    """
    own = native.Calibration.of_header(header)
    if own is not None:
        return Calibration(own, 0)
    if lens_model == 0:
        raise FrameFormatError("only frames of a camera have a calibration; those of a batch have one for each camera, whose own topics tell it")
    deadline = time.monotonic() + _LOOK_FOR_SECS
    while (found := _known.get(crc)) is None:
        text = None if look is None else look()
        if text is None:
            raise GantryError(f"the numbers of this frame's lens, calibration_crc {crc:#010x}, are in world/info, which came neither with the frame nor before")
        take(text)
        if crc not in _known and time.monotonic() > deadline:
            raise GantryError(f"world/info describes no camera with the calibration_crc {crc:#010x} of this frame; was it sent by an older simulator?")
        if crc not in _known:
            time.sleep(_LOOK_SECS)
    return found
