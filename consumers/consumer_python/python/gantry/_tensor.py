"""A colour image as the dense input of a network."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ._errors import FrameFormatError

if TYPE_CHECKING:
    from ._frame import Frame

Dtype = Literal["uint8", "float16", "bfloat16", "float32"]
Layout = Literal["chw", "hwc"]
Colour = Literal["rgb", "bgr", "bgra"]

#: Bytes of a pixel, which is B G R A, in the order of the tensor's colours.
_ORDERS = {"rgb": [2, 1, 0], "bgr": [0, 1, 2], "bgra": [0, 1, 2, 3]}
_DTYPES = ("uint8", "float16", "bfloat16", "float32")
_LAYOUTS = ("chw", "hwc")


def _one_of(name: str, value: Any, allowed: Any) -> str:
    if value not in allowed:
        raise ValueError(f"{name} is {value!r}; it must be one of {', '.join(allowed)}")
    return str(value)


def tensor(frame: Frame, dtype: str, layout: str, colour: str, scale: float | None, out: Any, device: Any) -> Any:
    """Does what `Frame.tensor` says."""
    _one_of("dtype", dtype, _DTYPES)
    _one_of("layout", layout, _LAYOUTS)
    order = _ORDERS[_one_of("colour", colour, _ORDERS)]
    if frame.modality != "rgb":
        raise FrameFormatError(f"frame.tensor needs a frame of rgb, this is {frame.modality}")
    if frame.device is not None:
        raise FrameFormatError("this frame is on the GPU: frame.torch() is its tensor there (h, w, 4), in the order B G R A")
    if dtype == "uint8" and scale is not None:
        raise ValueError(f"scale is {scale} and dtype is uint8, whose bytes stay as they are; leave scale out, or take a float")
    factor = 1 / 255 if scale is None else float(scale)
    width, height = frame.size
    shape: tuple[int, ...] = (len(order), height, width) if layout == "chw" else (height, width, len(order))
    if frame.n_images:
        shape = (frame.n_images, *shape)
    if out is None and device is None:
        if dtype == "bfloat16":
            raise ValueError('dtype is bfloat16, which numpy lacks; say device="cpu" or "cuda" for a tensor of torch, or give out')
        return _filled(frame, np.empty(shape, dtype), dtype, layout, order, factor)
    if isinstance(out, np.ndarray):
        if device is not None:
            raise ValueError(f"device is {device!r} and out an array of numpy, which is on none; leave device out")
        _check_out(out, out.dtype.name, shape, dtype, out.flags.c_contiguous and out.flags.writeable)
        return _filled(frame, out, dtype, layout, order, factor)
    return _torch(frame, dtype, layout, order, factor, shape, out, device)


def _check_out(out: Any, found: str, shape: tuple[int, ...], dtype: str, is_dense: bool) -> None:
    if found != dtype or tuple(out.shape) != shape or not is_dense:
        raise ValueError(
            f"out is {found} {tuple(out.shape)}{'' if is_dense else ', not contiguous and writeable'}; "
            f"it must be {dtype} {shape}, contiguous and writeable"
        )


def _filled(frame: Frame, array: Any, dtype: str, layout: str, order: list[int], factor: float) -> Any:
    frame.fill_tensor(array.reshape(-1).view(np.uint8), dtype=dtype, planar=layout == "chw", order=order, scale=factor)
    return array


def _numbers_of(torch: Any, tensor: Any) -> Any:
    """The memory of a tensor on the host as an array; numpy knows bfloat16 as 16 bits only."""
    return (tensor.view(torch.int16) if tensor.dtype == torch.bfloat16 else tensor).numpy()


def _torch(frame: Frame, dtype: str, layout: str, order: list[int], factor: float, shape: tuple[int, ...], out: Any, device: Any) -> Any:
    torch: Any = importlib.import_module("torch")
    if out is not None:
        if not isinstance(out, torch.Tensor):
            raise ValueError(f"out is {type(out).__name__}; it must be an array of numpy or a tensor of torch")
        wanted = out.device if device is None else torch.device(device)
        # "cuda" is any of them.
        if wanted.type != out.device.type or wanted.index not in (None, out.device.index):
            raise ValueError(f"device is {device!r} and out is on {out.device}; leave device out")
        _check_out(out, str(out.dtype).removeprefix("torch."), shape, dtype, out.is_contiguous())
        device = out.device
    target = torch.device(device)
    if out is not None and target.type == "cpu":
        _filled(frame, _numbers_of(torch, out), dtype, layout, order, factor)
        return out
    # Pinned memory is uploaded while the program goes on; torch keeps it until the copy is done.
    host = torch.empty(shape, dtype=getattr(torch, dtype), pin_memory=target.type == "cuda")
    _filled(frame, _numbers_of(torch, host), dtype, layout, order, factor)
    if out is not None:
        return out.copy_(host, non_blocking=True)
    return host if target.type == "cpu" else host.to(target, non_blocking=True)
