"""Data sets and their loader."""

from __future__ import annotations

import importlib
import os
from typing import Any, Callable, Literal, Sequence, Union

from ._samples import Samples

Image = Any
Target = dict[str, Any]


def _torch() -> Any:
    try:
        return importlib.import_module("torch")
    except ImportError as cause:
        raise ImportError(f"gantry.torch needs torch, which cannot be imported ({cause}); pip install torch") from cause


class Dataset(Samples):
    """Images and targets by number (map-style), of any number of recordings and exported sets.

    A source is a recording with `rgb`, `instance` and `semantic` images of a camera, or a folder that
    `gantry export --format coco` wrote; `camera` (`ego/front`) and `part` (`train`) choose where there are
    several. An image is a tensor (3, h, w), R G B, `float32` from 0 to 1 or `uint8`. Its target is what
    torchvision's detectors take: `boxes` float32 (n, 4) `[x0, y0, x1, y1]`, `labels` int64 (n,), `area`,
    `iscrowd`, `image_id`. A label is a number in `classes`, by default all of `CATEGORY_NAMES`, from
    `first_label` on: 1 where 0 is the background, as in torchvision. Both kinds of source have the same
    objects in the same order: each id and category with at least `min_pixels` visible pixels, without the
    vehicle that carries the camera. `transform` gets image and target, and returns both; to travel to
    workers it is a function or an object of a module. Raises `GantryError` for what is not there,
    `ValueError` for a class that is none. It opens files in the process that reads them.
    """

    def __init__(
        self,
        *sources: Union[str, os.PathLike[str]],
        classes: Sequence[str] | None = None,
        camera: str | None = None,
        part: str | None = None,
        min_pixels: int = 10,
        dtype: Literal["float32", "uint8"] = "float32",
        first_label: int = 0,
        transform: Callable[[Image, Target], tuple[Image, Target]] | None = None,
    ) -> None:
        super().__init__(*sources, classes=classes, camera=camera, part=part, min_pixels=min_pixels)
        if dtype not in ("float32", "uint8"):
            raise ValueError(f"dtype is {dtype!r}; it must be float32 or uint8")
        self._dtype, self._first_label, self._transform = dtype, first_label, transform

    def __getitem__(self, i: int) -> tuple[Image, Target]:
        torch = _torch()
        found = self.sample(i)
        image = torch.from_numpy(found.image)
        if self._dtype == "float32":
            image = image.float().div_(255)
        target = {
            "boxes": torch.from_numpy(found.boxes),
            "labels": torch.from_numpy(found.labels + self._first_label),
            "area": torch.from_numpy(found.areas),
            "iscrowd": torch.from_numpy(found.crowds),
            "image_id": i % len(self),
        }
        return (image, target) if self._transform is None else self._transform(image, target)


def collate(samples: Sequence[tuple[Image, Target]]) -> tuple[Image, list[Target]]:
    """Joins samples to a batch: images of one size as one tensor (n, 3, h, w), others as a list; targets as a list."""
    images = [image for image, _ in samples]
    joined = _torch().stack(images) if len({tuple(image.shape) for image in images}) == 1 else images
    return joined, [target for _, target in samples]


def loader(dataset: Any, batch_size: int = 1, *, workers: int = 0, **options: Any) -> Any:
    """Returns a `torch.utils.data.DataLoader` over a data set, with `workers` processes that are spawned.

    A forked process cannot use this package, and forking is torch's default here. `options` are those
    of `DataLoader`; `collate_fn` is `collate` unless it is given.
    """
    data: Any = importlib.import_module("torch.utils.data") if _torch() else None
    options.setdefault("collate_fn", collate)
    if workers:
        options.setdefault("multiprocessing_context", "spawn")
        options.setdefault("persistent_workers", True)
    return data.DataLoader(dataset, batch_size, num_workers=workers, **options)
