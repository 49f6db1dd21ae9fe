"""Makes the records of results from columns: one array per field, broadcast against the others.

Every function returns what `Publisher.send` of its type takes. Numbers follow SPEC.md §9: pixels
count from the outer corner of the top-left pixel, metres and radians, quaternions [x, y, z, w].
"""

from __future__ import annotations

from typing import Any, Iterable, Mapping, NamedTuple, Sequence

import numpy as np
import numpy.typing as npt

from ._dtypes import BOX2D, BOX3D, KEYPOINT, KEYPOINT_SET, MASK, ODOMETRY, PATH_POINT, POSE_ESTIMATE, RUN, SCALAR, TRACK

Columns = npt.ArrayLike
Records = npt.NDArray[Any]


class RecordsAndTail(NamedTuple):
    """Records, and what lies behind all of them."""

    #: Structured array (n,).
    records: Records
    #: Runs of masks, or key points.
    tail: Records


def _fill(dtype: np.dtype[Any], n: int, columns: Mapping[str, Any]) -> Records:
    records = np.zeros(n, dtype)
    for name, column in columns.items():
        if column is not None:
            column = on_host(column)
            try:
                records[name] = column
            except ValueError as cause:
                wanted = (n, *records[name].shape[1:])
                raise ValueError(f"{name} has the shape {np.shape(column)}, which is not that of {n} records: {wanted}") from cause
    return records


def on_host(column: Any) -> Any:
    """Returns what numpy takes of a column: tensors of networks are taken off their graph and their device."""
    if isinstance(column, np.ndarray) or not hasattr(column, "__dlpack__"):
        return column
    tensor: Any = column
    for step in ("detach", "cpu"):
        # torch's; arrays of cupy come by `get`, those of jax by themselves.
        tensor = getattr(tensor, step)() if hasattr(tensor, step) else tensor
    if "bfloat16" in str(tensor.dtype) and hasattr(tensor, "float"):
        # numpy has no such type.
        tensor = tensor.float()
    return tensor.get() if type(tensor).__module__.partition(".")[0] == "cupy" else np.asarray(tensor)


def _rows(column: Columns, width: int, name: str) -> npt.NDArray[np.float64]:
    rows = np.asarray(on_host(column), np.float64)
    if rows.size == 0:
        return np.zeros((0, width))
    rows = np.atleast_2d(rows)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name} has the shape {np.shape(column)}; it must be (n, {width})")
    return rows


def _quaternions(n: int, rotation_xyzw: Columns | None, yaw_rad: Columns | None) -> npt.NDArray[np.float64]:
    turned = np.zeros((n, 4))
    turned[:, 3] = 1.0
    if rotation_xyzw is not None and yaw_rad is not None:
        raise ValueError("say either rotation_xyzw or yaw_rad")
    if rotation_xyzw is not None:
        turned[:] = on_host(rotation_xyzw)
    if yaw_rad is not None:
        half = np.broadcast_to(np.asarray(on_host(yaw_rad), np.float64) / 2, (n,))
        turned[:, 2], turned[:, 3] = np.sin(half), np.cos(half)
    return turned


def _set_pose(records: Records, at_m: Columns, rotation_xyzw: Columns | None, yaw_rad: Columns | None) -> None:
    records["pose"]["translation_m"] = on_host(at_m)
    records["pose"]["rotation_xyzw"] = _quaternions(len(records), rotation_xyzw, yaw_rad)


def boxes2d(
    min_px: Columns | None = None,
    max_px: Columns | None = None,
    *,
    xyxy: Columns | None = None,
    xywh: Columns | None = None,
    cxcywh: Columns | None = None,
    score: Columns = 1.0,
    class_: Columns = 0,
    id: Columns = 0,
) -> Records:
    """Boxes in an image, pixels: confidence 0 to 1, class and object numbers, and one of four ways to say where they are.

    Corners `min_px` and `max_px` (n, 2) `[x, y]`, or as networks give them (n, 4): `xyxy` both corners,
    `xywh` the first corner, width and height, `cxcywh` the centre, width and height. Every argument may
    be an array or a tensor on any device, on its graph or not.
    """
    ways = {"min_px and max_px": min_px if max_px is None else max_px, "xyxy": xyxy, "xywh": xywh, "cxcywh": cxcywh}
    said = [name for name, way in ways.items() if way is not None]
    if len(said) != 1 or (min_px is None) != (max_px is None):
        given = "one corner" if len(said) == 1 else ", ".join(said) or "no boxes"
        raise ValueError(f"boxes2d is given {given}; say where the boxes are in one way: min_px and max_px, xyxy, xywh or cxcywh")
    if min_px is not None and max_px is not None:
        low, high = _rows(min_px, 2, "min_px"), _rows(max_px, 2, "max_px")
    else:
        (name,) = said
        rows = _rows(ways[name], 4, name)  # type: ignore[arg-type]
        low, high = rows[:, :2], rows[:, 2:]
        if name == "xywh":
            high = low + high
        elif name == "cxcywh":
            low, high = low - high / 2, low + high / 2
    return _fill(BOX2D, len(low), {"min_px": low, "max_px": high, "score": score, "class": class_, "id": id})


def boxes3d(
    center_m: Columns,
    half_m: Columns | None = None,
    *,
    size_m: Columns | None = None,
    rotation_xyzw: Columns | None = None,
    yaw_rad: Columns | None = None,
    velocity_mps: Columns = np.nan,
    score: Columns = 1.0,
    class_: Columns = 0,
    id: Columns = 0,
    n_points: Columns = 0,
) -> Records:
    """Boxes in space: centres (n, 3), half sizes or sizes (n, 3) in metres, their turn as quaternions or about z.

    Every argument may be an array or a tensor on any device, on its graph or not.
    """
    if (half_m is None) == (size_m is None):
        raise ValueError("boxes3d needs the boxes' sizes in one way: half_m or size_m")
    centers = _rows(center_m, 3, "center_m")
    half_m = _rows(size_m, 3, "size_m") / 2 if size_m is not None else half_m
    columns = {"half_m": half_m, "velocity_mps": velocity_mps, "score": score, "class": class_, "id": id, "n_points": n_points}
    records = _fill(BOX3D, len(centers), columns)
    _set_pose(records, centers, rotation_xyzw, yaw_rad)
    return records


#: Numbers of a track's states.
TRACK_STATES = {"tentative": 0, "confirmed": 1, "lost": 2, "ended": 3}
_IN_IMAGE, _IN_SPACE = 1, 2


def tracks(
    id: Columns,
    *,
    min_px: Columns | None = None,
    max_px: Columns | None = None,
    velocity_pxps: Columns = 0.0,
    center_m: Columns | None = None,
    half_m: Columns | None = None,
    rotation_xyzw: Columns | None = None,
    yaw_rad: Columns | None = None,
    velocity_mps: Columns = np.nan,
    yaw_rate_radps: Columns = np.nan,
    state: str | Sequence[str] = "confirmed",
    score: Columns = 1.0,
    class_: Columns = 0,
    n_hits: Columns = 0,
    n_missed: Columns = 0,
    age_secs: Columns = 0.0,
) -> Records:
    """Tracked objects with ids (n,): a box in the image, a box in space, or both.

    `state` is `tentative`, `confirmed`, `lost` or `ended`, for all or one per track.
    """
    ids = np.atleast_1d(np.asarray(on_host(id)))
    names = [state] * len(ids) if isinstance(state, str) else list(state)
    unknown = [name for name in names if name not in TRACK_STATES]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is no state of a track; it must be one of {', '.join(TRACK_STATES)}")
    columns = {
        "id": ids, "class": class_, "state": [TRACK_STATES[name] for name in names], "score": score, "n_hits": n_hits, "n_missed": n_missed,
        "age_secs": age_secs, "min_px": min_px, "max_px": max_px, "velocity_pxps": velocity_pxps, "half_m": half_m,
        "velocity_mps": velocity_mps, "yaw_rate_radps": yaw_rate_radps,
        "flags": _IN_IMAGE * (min_px is not None) | _IN_SPACE * (center_m is not None),
    }  # fmt: skip
    if (min_px is None) != (max_px is None) or (center_m is None) != (half_m is None):
        raise ValueError("a box in the image needs min_px and max_px, a box in space center_m and half_m")
    records = _fill(TRACK, len(ids), columns)
    _set_pose(records, np.zeros(3) if center_m is None else center_m, rotation_xyzw, yaw_rad)
    return records


def masks(
    images: Iterable[Columns], *, score: Columns = 1.0, class_: Columns = 0, id: Columns = 0
) -> RecordsAndTail:
    """Masks from images (h, w) of bool or integers, all of one size; boxes and COCO's runs are computed.

    They may be one array or tensor (n, h, w), on any device. Probabilities are compared first: `masks[:, 0] > 0.5`.
    """
    pictures = [np.asarray(on_host(image)) for image in on_host(images)]
    if any(picture.dtype.kind == "f" for picture in pictures):
        raise ValueError("masks are images of bool or integers, and these are of floating-point numbers; compare probabilities first: masks > 0.5")
    pictures = [picture.astype(bool) for picture in pictures]
    if len({picture.shape for picture in pictures}) > 1 or any(picture.ndim != 2 for picture in pictures):
        raise ValueError("masks must be images (h, w) of one size")
    records, runs, first = _fill(MASK, len(pictures), {"score": score, "class": class_, "id": id}), [], 0
    for record, picture in zip(records, pictures):
        flat = picture.T.reshape(-1)
        ends = np.flatnonzero(np.diff(flat)) + 1
        lengths = np.diff(np.concatenate(([0], ends, [flat.size])))
        if flat.size and flat[0]:
            lengths = np.concatenate(([0], lengths))
        ys, xs = np.nonzero(picture)
        if len(xs):
            record["min_px"], record["max_px"] = (xs.min(), ys.min()), (xs.max() + 1, ys.max() + 1)
        record["first_run"], record["n_runs"] = first, len(lengths)
        first += len(lengths)
        runs.append(lengths)
    return RecordsAndTail(records, np.concatenate([np.zeros(0, RUN), *runs]).astype(RUN))


def keypoints(
    at_px: Columns | Sequence[Columns],
    *,
    point_score: Columns | Sequence[Columns] | None = None,
    visibility: Columns | Sequence[Columns] | None = None,
    score: Columns = 1.0,
    class_: Columns = 0,
    id: Columns = 0,
) -> RecordsAndTail:
    """Key points of objects: per object an array (k, 2) `[x, y]` in pixels, which may differ in k; or one (n, k, 2).

    All may be tensors on any device. `visibility` is 0 not labelled, 1 hidden, 2 visible, as COCO counts; the default is 2.
    """
    parts = []
    scores: Any = on_host(point_score)
    seen: Any = on_host(visibility)
    for i, column in enumerate(on_host(at_px)):
        points = _rows(column, 2, "at_px")
        columns = {"at_px": points, "score": 1.0 if scores is None else scores[i], "visibility": 2 if seen is None else seen[i]}
        parts.append(_fill(KEYPOINT, len(points), columns))
    counts = np.array([len(part) for part in parts], np.int64)
    columns = {"score": score, "class": class_, "id": id, "first_point": np.cumsum(counts) - counts, "n_points": counts}
    return RecordsAndTail(_fill(KEYPOINT_SET, len(parts), columns), np.concatenate([np.zeros(0, KEYPOINT), *parts]))


def pose(
    translation_m: Columns,
    *,
    rotation_xyzw: Columns | None = None,
    yaw_rad: Columns | None = None,
    covariance: Columns | None = None,
) -> Records:
    """One pose: position (3,) in metres, turn, covariance (6, 6) of position and rotation (m², rad²)."""
    records = _fill(POSE_ESTIMATE, 1, {"covariance": _covariance(covariance)})
    _set_pose(records, translation_m, rotation_xyzw, yaw_rad)
    return records


def odometry(
    translation_m: Columns,
    *,
    rotation_xyzw: Columns | None = None,
    yaw_rad: Columns | None = None,
    velocity_mps: Columns = 0.0,
    angular_velocity_radps: Columns = 0.0,
    pose_covariance: Columns | None = None,
    twist_covariance: Columns | None = None,
) -> Records:
    """A pose, and velocity and rates of turn (3,) along the body's own axes, with covariances (6, 6)."""
    columns = {
        "velocity_mps": velocity_mps,
        "angular_velocity_radps": angular_velocity_radps,
        "pose_covariance": _covariance(pose_covariance),
        "twist_covariance": _covariance(twist_covariance),
    }
    records = _fill(ODOMETRY, 1, columns)
    _set_pose(records, translation_m, rotation_xyzw, yaw_rad)
    return records


def _covariance(matrix: Columns | None) -> npt.NDArray[np.float64] | None:
    if matrix is None:
        return None
    numbers = np.asarray(on_host(matrix), np.float64)
    if numbers.size != 36:
        raise ValueError(f"a covariance has the shape {numbers.shape}; it must be (6, 6)")
    return numbers.reshape(36)


def path(
    points_m: Columns,
    *,
    rotation_xyzw: Columns | None = None,
    yaw_rad: Columns | None = None,
    after_secs: Columns = np.nan,
    speed_mps: Columns = np.nan,
    acceleration_mps2: Columns = np.nan,
    curvature_pm: Columns = np.nan,
) -> Records:
    """A path: points (n, 3) in metres, and per point time, speed, acceleration, curvature; NaN is unknown."""
    points = _rows(points_m, 3, "points_m")
    columns = {"after_secs": after_secs, "speed_mps": speed_mps, "acceleration_mps2": acceleration_mps2, "curvature_pm": curvature_pm}
    records = _fill(PATH_POINT, len(points), columns)
    _set_pose(records, points, rotation_xyzw, yaw_rad)
    return records


def scalars(values: Mapping[str, float]) -> Records:
    """Named numbers; a unit belongs into the name (`speed_mps`), which has up to 56 bytes."""
    records = np.zeros(len(values), SCALAR)
    for record, (name, value) in zip(records, values.items()):
        text = name.encode()
        if len(text) > 56:
            raise ValueError(f"the name {name!r} has {len(text)} bytes; 56 are allowed")
        record["value"] = value
        record["name"][: len(text)] = np.frombuffer(text, np.uint8)
    return records
