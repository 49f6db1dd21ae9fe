"""Decodes the payloads of `gantry.Frame` with numpy; shares no code with the recorder. docs/how-to/recording.md shows the same functions.

    python codecs.py FOLDER

checks FOLDER/NAME.header, .codec and .coded against FOLDER/NAME.payload.
"""

import io
import pathlib
import struct
import sys

# begin
import numpy as np
import zstandard
from PIL import Image


def unfold(n):
    """0, 1, 2, 3, 4 become 0, -1, 1, -2, 2."""
    return np.where(n & 1, ~(n >> 1), n >> 1)


def joined(planes):
    """Words of planes of bytes, lowest byte first: [..., byte, n] becomes [..., n]."""
    return sum(planes[..., k, :].astype(np.uint32) << np.uint32(8 * k) for k in range(planes.shape[-2]))


def decode(codec, header, coded):
    """The payload. `header` is the frame's 256 bytes."""
    n_bytes, width, height, _, element_bytes = struct.unpack_from("<QIIII", header, 48)
    if codec == "":
        return coded
    if codec == "png":
        image = Image.open(io.BytesIO(coded))
        pixels = np.asarray(image)
        if image.mode == "P":
            return pixels.tobytes()
        alpha = pixels[..., 3] if image.mode == "RGBA" else np.full(pixels.shape[:2], 255, np.uint8)
        return np.dstack([pixels[..., 2], pixels[..., 1], pixels[..., 0], alpha]).tobytes()
    plain = zstandard.ZstdDecompressor().decompress(coded[4:])  # behind a CRC-32
    if codec == "zstd":
        return plain
    if codec == "events":
        return events(plain, n_bytes // 16)
    size = 2 if codec == "planes16" else 4
    planes = np.frombuffer(plain, np.uint8).reshape(element_bytes // size, size, -1)
    steps = unfold(joined(planes))
    if codec == "records32":  # each word continues the line through the two before
        words = steps.cumsum(1, np.uint32).cumsum(1, np.uint32)
        return np.ascontiguousarray(words.T).tobytes()
    # each word is left + above - above left + step
    words = steps.reshape(-1, height, width).cumsum(2, np.uint32).cumsum(1, np.uint32)
    if codec == "flow":  # where each pixel came from
        y, x = np.mgrid[:height, :width].astype(np.float32) + np.float32(0.5)
        words = np.stack([x, y]) - words.view(np.float32)
    words = words.astype(np.uint16) if size == 2 else words
    return np.ascontiguousarray(words.transpose(1, 2, 0)).tobytes()


DVS = np.dtype([("nanos", "<u4"), ("x", "<u2"), ("y", "<u2"), ("id", "<u4"), ("polarity", "u1"), ("class", "u1"), ("_", "<u2")])


def events(plain, n):
    (n_pixels,) = struct.unpack_from("<I", plain)
    at = 4

    def words(count):
        nonlocal at
        at += 4 * count
        return joined(np.frombuffer(plain, np.uint8, 4 * count, at - 4 * count).reshape(4, count))

    pixels = words(n_pixels).cumsum(dtype=np.uint32)
    counts = words(n_pixels) + np.uint32(1)
    objects = unfold(words(n_pixels)).cumsum(dtype=np.uint32)
    nanos, n_second = words(n_pixels), int((counts > 1).sum())
    second, later = words(n_second), unfold(words(n - n_pixels - n_second))
    classes = np.frombuffer(plain, np.uint8, n_pixels, at)
    bits = np.unpackbits(np.frombuffer(plain, np.uint8, -1, at + n_pixels))[:n]

    of = np.repeat(np.arange(n_pixels), counts)  # pixel of each event
    first = np.cumsum(counts) - counts
    nth = np.arange(n) - first[of]

    def within(values):  # sums that begin again at each pixel
        total = values.cumsum(dtype=np.uint32)
        return total - (total - values)[first][of]

    waits = np.zeros(n, np.uint32)
    waits[nth == 1], waits[nth > 1] = second, later
    out = np.zeros(n, DVS)
    out["nanos"] = nanos[of] + within(within(waits))
    out["x"], out["y"] = pixels[of] & 0xFFFF, pixels[of] >> 16
    out["id"], out["class"], out["polarity"] = objects[of], classes[of], within(bits.astype(np.uint32)) & 1
    return out[np.lexsort([out["x"], out["y"], out["nanos"]])].tobytes()
# end


def check(folder):
    names = sorted(path.stem for path in pathlib.Path(folder).glob("*.header"))
    assert names, folder
    for name in names:
        part = lambda ending: (pathlib.Path(folder) / f"{name}.{ending}").read_bytes()
        codec = part("codec").decode()
        assert decode(codec, part("header"), part("coded")) == part("payload"), (name, codec)
        print(name, codec, len(part("payload")))


if __name__ == "__main__":
    check(sys.argv[1])
