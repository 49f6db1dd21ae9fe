"""Publishing results that stay on a GPU: the same calls, with tensors instead of arrays."""

from __future__ import annotations

import json
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from ._dtypes import PIXELS
from ._load import native
from ._pose import Pose
from ._publish import _PIXEL_TYPES, Answered, Loan, Publisher, _name_inputs, said

#: DLPack's kinds of memory.
_CPU, _CUDA, _CUDA_HOST, _CUDA_MANAGED = 1, 2, 3, 13


class GpuArray:
    """A slot of the GPU's memory, writeable: what `torch.from_dlpack`, cupy and jax take."""

    def __init__(self, loan: native.GpuLoan, shape: Sequence[int], dtype: np.dtype[Any]) -> None:
        #: Sizes, slowest dimension first.
        self.shape: tuple[int, ...] = tuple(shape)
        #: Type of the elements.
        self.dtype = dtype
        self._loan = loan

    def torch(self) -> Any:
        """Returns the slot as a tensor of torch, to be written to until the loan is sent."""
        return self._loan.torch()

    def __dlpack__(self, **_: Any) -> Any:
        return self._loan.capsule()

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._loan.device_number()

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        found = self._loan.interface()
        assert found is not None
        address, shape, strides, kind = found
        return {"shape": tuple(shape), "typestr": kind, "data": (address, False), "version": 3, "strides": tuple(strides), "stream": None}

    def __repr__(self) -> str:
        return f"<gantry.GpuArray {self.shape} {self.dtype}>"


class GpuLoan(Loan):
    """A slot of the GPU's memory that is filled in place: a context manager that gives its `GpuArray`."""

    def __init__(self, loan: native.GpuLoan, slot: GpuArray, type_: str) -> None:
        super().__init__(loan, slot, type_)
        #: The slot, writeable; it holds the bytes of an earlier result.
        self.slot = slot

    def __enter__(self) -> GpuArray:  # type: ignore[override]
        return self.slot

    def send(self) -> int:
        """Sends the result once the GPU has done what it was given, and returns the number of readers."""
        self.n_received = n_received = int(self._loan.send())
        return n_received

    def give_back(self) -> None:
        """Gives the slot back unsent."""
        self._loan.give_back()


class GpuPublisher(Publisher):
    """The one writer of a topic of results that stay on a GPU."""

    def __init__(
        self, topic: str, type: str, domain: str | None, about: dict[str, Any], capacities: dict[str, int], point: np.dtype[Any], device: str
    ) -> None:
        self._wish = device
        super().__init__(topic, type, domain, about, capacities, point)
        self._number: int = self._native.device()
        self.device = f"cuda:{self._number}"

    def _open(self, about: dict[str, Any], capacities: dict[str, int]) -> Any:
        return native.GpuPublisher(self._domain, self.name, self.type, device=self._wish, about=json.dumps(about), **capacities)

    @property
    def device_bytes(self) -> int:
        """Memory of the GPU that the topic has for its slots now, bytes."""
        return int(self._native.device_bytes())

    def loan(
        self,
        shape: int | Sequence[int],
        dtype: npt.DTypeLike | None = None,
        *,
        format: str | None = None,
        answers: Answered = None,
        tick: int | None = None,
        sim_time: float | None = None,
        space: str | None = None,
        pose: Pose | None = None,
        intrinsics_px: Sequence[float] | None = None,
    ) -> GpuLoan:
        """Loans a slot of the GPU's memory for one result, to be filled without a copy:

            with topic.loan((64, 128, 128), "float16", answers=frame) as slot:
                torch.relu(features, out=slot.torch())

        `dtype` may be numpy's or torch's. Leaving the `with` block waits for what the GPU was given
        and sends the result; its tensors must not be written to afterwards. The rest, and errors,
        are as those of a topic in shared memory.
        """
        sizes = (int(shape),) if isinstance(shape, (int, np.integer)) else tuple(int(size) for size in shape)
        item, name = self._item(sizes, _numpy(dtype), format)
        n_bytes = item.itemsize
        for size in sizes:
            n_bytes *= size
        loan = self._native.loan(n_bytes)
        try:
            self._say(loan, sizes, name, answers, tick, sim_time, space, pose, intrinsics_px)
        except BaseException:
            loan.give_back()
            raise
        return GpuLoan(loan, GpuArray(loan, sizes, item), self.type)

    def send(
        self,
        data: Any,
        *,
        format: str | None = None,
        answers: Answered = None,
        tick: int | None = None,
        sim_time: float | None = None,
        space: str | None = None,
        pose: Pose | None = None,
        intrinsics_px: Sequence[float] | None = None,
        size_px: tuple[int, int] | None = None,
    ) -> int:
        """Copies one result within the GPU, sends it when the copy is done, and returns the number of readers.

        `data` is a tensor of torch, cupy or jax on the topic's device, or whatever else has
        `__dlpack__` or `__cuda_array_interface__`; the copy waits for the stream that is current
        there. Arrays in the processor's memory are uploaded. Raises `ValueError` for a tensor of
        another device or of a type that cannot be sent; the rest is as that of a topic in shared memory.
        """
        given = self._taken(data)
        if isinstance(given, native.Foreign):
            sizes, dtype = tuple(given.sizes), np.dtype(given.dtype)
        else:
            sizes, dtype = given.shape, given.dtype
        _, name = self._item(sizes, dtype, format)
        loan = self._native.draft()
        self._say(loan, sizes, name, answers, tick, sim_time, space, pose, intrinsics_px)
        if isinstance(given, native.Foreign):
            return int(loan.send_array(given))
        return int(loan.send_bytes(np.ascontiguousarray(given).reshape(-1).view(np.uint8)))

    def _say(
        self,
        loan: native.GpuLoan,
        sizes: Sequence[int],
        name: str,
        answers: Answered,
        tick: int | None,
        sim_time: float | None,
        space: str | None,
        pose: Pose | None,
        intrinsics_px: Sequence[float] | None,
    ) -> None:
        """Writes into the header what is known of a result."""
        if self.type in _PIXEL_TYPES:
            assert name in PIXELS
            loan.set_image(sizes[1], sizes[0], name)
        else:
            loan.set_tensor(name, sizes)
        _name_inputs(loan, answers)
        loan.describe(said(tick, sim_time, space, pose, intrinsics_px))

    def _taken(self, data: Any) -> native.Foreign | npt.NDArray[Any]:
        """Takes the memory of a tensor on the device; anything else as an array of numpy."""
        taken = self._on_device(data)
        if taken is None:
            return np.asarray(data)
        if taken.is_contiguous:
            return taken
        # torch's name for it, and cupy's.
        make = getattr(data, "contiguous", None) or getattr(data, "copy", None)
        again = None if make is None else self._on_device(make())
        if again is None or not again.is_contiguous:
            raise ValueError(f"the elements of this {type(data).__name__} do not lie one behind the other; send a contiguous copy")
        return again

    def _on_device(self, data: Any) -> native.Foreign | None:
        if hasattr(data, "__dlpack_device__"):
            kind, number = (int(part) for part in data.__dlpack_device__())
            if kind in (_CPU, _CUDA_HOST):
                return None
            if kind not in (_CUDA, _CUDA_MANAGED):
                raise ValueError(f"this {type(data).__name__} is on a device of DLPack's kind {kind}; the topic is on {self.device}")
            self._same_device(number, data)
            # Whoever made it lets our stream wait for it.
            return native.take_capsule(data.__dlpack__(stream=self._native.stream()))
        interface = getattr(data, "__cuda_array_interface__", None)
        if interface is None:
            return None
        taken = native.take_interface(data, interface["data"][0], list(interface["shape"]), _listed(interface.get("strides")), interface["typestr"])
        self._same_device(taken.device, data)
        if interface.get("version", 0) < 3 or interface.get("stream") is not None:
            self._native.wait_for_work()
        return taken

    def _same_device(self, number: int, data: Any) -> None:
        if number != self._number:
            raise ValueError(
                f'this {type(data).__name__} is on cuda:{number}, and the topic on {self.device}; send tensor.to("{self.device}"), '
                f'or publish with device="cuda:{number}"'
            )


def _listed(strides: Sequence[int] | None) -> list[int] | None:
    return None if strides is None else list(strides)


def _numpy(dtype: Any) -> np.dtype[Any] | None:
    """Returns numpy's type of the same name as torch's."""
    if dtype is None:
        return None
    found: np.dtype[Any]
    try:
        found = np.dtype(dtype)
        return found
    except TypeError:
        name = str(dtype).rpartition(".")[2]
    try:
        found = np.dtype(name)
        return found
    except TypeError:
        raise ValueError(f"a tensor of {name} cannot be sent; bool, int, uint and float of 8 to 64 bits can") from None
