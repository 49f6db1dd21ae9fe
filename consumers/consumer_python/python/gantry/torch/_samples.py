"""Images and the objects in them, by number, out of recordings and of sets that `gantry export` wrote."""

from __future__ import annotations

import bisect
import importlib
import json
import os
from typing import Any, NamedTuple, Sequence, Union

import numpy as np
import numpy.typing as npt

from .._classes import CLASS_NAMES
from .._errors import GantryError
from .._frame import Frame
from .._recording import Recording

#: Categories of COCO that pixels can have: COCO's number, name, classes of pixels. `gantry export` writes the same.
_CATEGORIES: tuple[tuple[int, str, tuple[str, ...]], ...] = (
    (1, "person", ("Pedestrians", "Rider")),
    (2, "bicycle", ("Bicycle",)),
    (3, "car", ("Car",)),
    (4, "motorcycle", ("Motorcycle",)),
    (6, "bus", ("Bus",)),
    (7, "train", ("Train",)),
    (8, "truck", ("Truck",)),
    (10, "traffic light", ("TrafficLight",)),
)
#: Names of all categories, in COCO's order.
CATEGORY_NAMES = tuple(name for _, name, _ in _CATEGORIES)
#: COCO's number by class of a pixel; 0 is none.
_NUMBER_OF_CLASS = np.zeros(256, np.uint64)
for _number, _, _classes in _CATEGORIES:
    for _class in _classes:
        _NUMBER_OF_CLASS[CLASS_NAMES.index(_class)] = _number
_NAME_OF_NUMBER = {number: name for number, name, _ in _CATEGORIES}

#: Most recordings that a process keeps open.
_MOST_OPEN = 16


class Objects(NamedTuple):
    """The objects that an image shows, by COCO's rules: what is visible counts."""

    #: Corners [x0, y0, x1, y1], pixels, float32 (n, 4).
    boxes: npt.NDArray[np.float32]
    #: COCO's numbers of their categories, int64 (n,).
    categories: npt.NDArray[np.int64]
    #: Visible pixels, int64 (n,).
    areas: npt.NDArray[np.int64]
    #: 1 for a box round many objects, int64 (n,).
    crowds: npt.NDArray[np.int64]


class Sample(NamedTuple):
    """An image and its objects."""

    #: Colours in planes, R G B, uint8 (3, h, w).
    image: npt.NDArray[np.uint8]
    #: Corners [x0, y0, x1, y1], pixels, float32 (n, 4).
    boxes: npt.NDArray[np.float32]
    #: Numbers in `Samples.classes`, int64 (n,).
    labels: npt.NDArray[np.int64]
    #: Visible pixels, int64 (n,).
    areas: npt.NDArray[np.int64]
    #: 1 for a box round many objects, int64 (n,).
    crowds: npt.NDArray[np.int64]


def objects_of(instance: Frame, semantic: Frame, min_pixels: int) -> Objects:
    """Returns what two images of one tick and camera show, as `gantry export --format coco` does: an object for each id
    and category, without the vehicle that carries the camera, and without those of fewer pixels than `min_pixels`."""
    ids, numbers = instance.array, _NUMBER_OF_CLASS[semantic.array]
    if ids.shape != numbers.shape:
        raise GantryError(f"{instance.topic} has images {ids.shape} and {semantic.topic} {numbers.shape}; they must be of one size")
    rows, columns = np.nonzero((numbers > 0) & (ids != 0) & (ids != instance.header.parent_id))
    keys = (ids[rows, columns].astype(np.uint64) << np.uint64(8)) | numbers[rows, columns]
    order = np.argsort(keys, kind="stable")
    keys, rows, columns = keys[order], rows[order], columns[order]
    starts = np.flatnonzero(np.diff(keys, prepend=keys[:1] ^ np.uint64(1)))
    if not len(starts):
        return _no_objects()
    areas = np.diff(starts, append=len(keys))
    edges = (np.minimum.reduceat(columns, starts), np.minimum.reduceat(rows, starts),
             np.maximum.reduceat(columns, starts) + 1, np.maximum.reduceat(rows, starts) + 1)  # fmt: skip
    kept = areas >= max(min_pixels, 1)
    categories = (keys[starts] & np.uint64(0xFF)).astype(np.int64)
    boxes = np.stack(edges, axis=1).astype(np.float32)
    return Objects(boxes[kept], categories[kept], areas[kept].astype(np.int64), np.zeros(int(kept.sum()), np.int64))


def _no_objects() -> Objects:
    empty = np.zeros(0, np.int64)
    return Objects(np.zeros((0, 4), np.float32), empty, empty, empty)


class _ExportedSet:
    """A part of a set in COCO's form. Numbers are kept in arrays, so that it travels to other processes as it is."""

    def __init__(self, folder: str, part: str | None, min_pixels: int) -> None:
        self.folder = folder
        lists = os.path.join(folder, "annotations")
        parts = sorted(name[len("instances_") : -len(".json")] for name in os.listdir(lists) if name.startswith("instances_") and name.endswith(".json"))
        if part is None and len(parts) == 1:
            (part,) = parts
        if part not in parts:
            raise GantryError(f"{folder} has the parts {', '.join(parts) or 'none'}; give one of them as part=, not {part!r}")
        self.part = part
        with open(os.path.join(lists, f"instances_{part}.json"), encoding="utf-8") as file:
            read = json.load(file)
        images = sorted(read["images"], key=lambda image: image["id"])
        self.files = [str(image["file_name"]) for image in images]
        at = {image["id"]: i for i, image in enumerate(images)}
        known = [it for it in read["annotations"] if it["category_id"] in _NAME_OF_NUMBER and it["area"] >= min_pixels]
        known.sort(key=lambda it: at[it["image_id"]])
        corner_and_size = np.array([it["bbox"] for it in known], np.float32).reshape(-1, 4)
        self.boxes = np.concatenate([corner_and_size[:, :2], corner_and_size[:, :2] + corner_and_size[:, 2:]], axis=1)
        self.numbers = np.array([(it["category_id"], round(it["area"]), it.get("iscrowd", 0)) for it in known], np.int64).reshape(-1, 3)
        counts = np.bincount([at[it["image_id"]] for it in known], minlength=len(images)) if known else np.zeros(len(images), np.int64)
        self.ends = np.cumsum(counts)

    def __len__(self) -> int:
        return len(self.files)

    def __repr__(self) -> str:
        return f"{self.folder} ({self.part})"

    def image(self, i: int) -> npt.NDArray[np.uint8]:
        """Returns the picture's pixels, R G B (3, h, w)."""
        path = os.path.join(self.folder, "images", self.part, self.files[i])
        try:
            pictures: Any = importlib.import_module("PIL.Image")
        except ImportError as cause:
            raise ImportError(f"pictures of exported sets are read with Pillow, which cannot be imported ({cause}); pip install pillow") from cause
        with pictures.open(path) as picture:
            return np.ascontiguousarray(np.asarray(picture.convert("RGB")).transpose(2, 0, 1))

    def objects(self, i: int) -> Objects:
        """Returns what the set says about the picture."""
        its = slice(self.ends[i - 1] if i else 0, self.ends[i])
        return Objects(self.boxes[its], *self.numbers[its].T)


class _Recorded:
    """The ticks of a recording of which one camera has colour, instance and semantic images."""

    #: Recordings that this process has open, by path.
    _open: dict[str, Recording] = {}

    def __init__(self, path: str, camera: str | None, min_pixels: int) -> None:
        self.path, self._min_pixels = path, min_pixels
        names = {topic.name for topic in self._recording().topics if topic.kind == "frame"}
        whole = sorted(name[: -len("/rgb")] for name in names if name.endswith("/rgb") and {f"{name[:-4]}/{other}" for other in ("instance", "semantic")} <= names)
        if camera is None and len(whole) == 1:
            (camera,) = whole
        if camera not in whole:
            raise GantryError(
                f"{path} has rgb, instance and semantic of {', '.join(whole) or 'no camera'}; "
                + (f"give one of them as camera=, not {camera!r}" if whole else "record these three modalities of one")
            )
        self.camera = camera
        # The smallest of the three says of which ticks there are images.
        self.ticks = np.array([frame.tick for frame in self._recording().frames(f"{camera}/semantic")], np.int64)

    def __len__(self) -> int:
        return len(self.ticks)

    def __repr__(self) -> str:
        return f"{self.path} ({self.camera})"

    def _recording(self) -> Recording:
        kept = _Recorded._open
        if self.path not in kept:
            while len(kept) >= _MOST_OPEN:
                kept.pop(next(iter(kept))).close()
            kept[self.path] = Recording(self.path)
        return kept[self.path]

    def _frame(self, modality: str, i: int) -> Frame:
        return self._recording().frame(f"{self.camera}/{modality}", int(self.ticks[i]))

    def image(self, i: int) -> npt.NDArray[np.uint8]:
        """Returns the frame's pixels, R G B (3, h, w)."""
        image: npt.NDArray[np.uint8] = self._frame("rgb", i).tensor()
        return image

    def objects(self, i: int) -> Objects:
        """Returns what the exact images of the tick show."""
        return objects_of(self._frame("instance", i), self._frame("semantic", i), self._min_pixels)


class Samples:
    """The images of several recordings and exported sets, numbered on, with the objects of the wanted classes."""

    def __init__(
        self,
        *sources: Union[str, os.PathLike[str]],
        classes: Sequence[str] | None = None,
        camera: str | None = None,
        part: str | None = None,
        min_pixels: int = 10,
    ) -> None:
        #: Names of the classes; a label is a number in it.
        self.classes: list[str] = list(CATEGORY_NAMES if classes is None else classes)
        unknown = [name for name in self.classes if name not in CATEGORY_NAMES]
        if unknown or not self.classes:
            raise ValueError(f"classes has {unknown[0] if unknown else 'nothing'!r}; there is {', '.join(CATEGORY_NAMES)}")
        if not sources:
            raise ValueError("there is nothing to read; give paths of recordings, or folders that gantry export wrote in COCO's form")
        self._label_of_number = np.full(max(_NAME_OF_NUMBER) + 1, -1, np.int64)
        for number, name in _NAME_OF_NUMBER.items():
            if name in self.classes:
                self._label_of_number[number] = self.classes.index(name)
        self._sources: list[_ExportedSet | _Recorded] = []
        for source in [os.fspath(source) for source in sources]:
            if os.path.isdir(source) and not os.path.isdir(os.path.join(source, "annotations")):
                raise GantryError(f"{source} has no folder annotations; gantry export --format coco makes one")
            self._sources.append(_ExportedSet(source, part, min_pixels) if os.path.isdir(source) else _Recorded(source, camera, min_pixels))
        #: Number behind the last image of each source.
        self._ends: list[int] = [int(end) for end in np.cumsum([len(source) for source in self._sources])]

    def __len__(self) -> int:
        return self._ends[-1]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {len(self)} images of {', '.join(map(repr, self._sources))}>"

    def sample(self, i: int) -> Sample:
        """Returns image `i` and its objects; a negative one counts from the end. Raises `IndexError`."""
        at = i + len(self) if i < 0 else i
        if not 0 <= at < len(self):
            raise IndexError(f"there is no image {i}; there are {len(self)}")
        n = bisect.bisect_right(self._ends, at)
        source, at = self._sources[n], at - (self._ends[n - 1] if n else 0)
        found = source.objects(at)
        labels = self._label_of_number[found.categories]
        kept = labels >= 0
        return Sample(source.image(at), found.boxes[kept], labels[kept], found.areas[kept], found.crowds[kept])
