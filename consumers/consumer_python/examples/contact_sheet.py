"""Saves one tick of a camera in all its modalities as one picture, like the one in the README.

    ./gantry up launch/picture.toml --view none &
    python consumers/consumer_python/examples/contact_sheet.py docs/images/front.png --after 12

Reads the frames of one tick with `gantry.sync`, colours labels, depth, flow and events, and puts
them side by side. Needs pillow.
"""

import argparse
import colorsys

import numpy as np
from PIL import Image

import gantry

MODALITIES = ["rgb", "depth", "semantic", "instance", "flow", "dvs"]


def depth_rgb(depth_m: np.ndarray) -> np.ndarray:
    """Near is bright, on a logarithmic scale from 1 to 150 m; sky is black."""
    near = np.clip(1.0 - np.log(np.clip(depth_m, 1.0, 150.0)) / np.log(150.0), 0.0, 1.0)
    return (np.stack([near, near**1.5, near**0.5 * (depth_m < 1e4)], -1) * 255).astype(np.uint8)


def instance_rgb(ids: np.ndarray) -> np.ndarray:
    """A colour per id; the background is black."""
    mixed = (ids.astype(np.uint64) * 0x9E3779B97F4A7C15) >> np.uint64(40)
    rgb = np.stack([mixed & 0xFF, (mixed >> np.uint64(8)) & 0xFF, (mixed >> np.uint64(16)) & 0xFF], -1).astype(np.uint8)
    return np.where(ids[..., None] == 0, 0, 60 + rgb // 4 * 3).astype(np.uint8)


def flow_rgb(flow_px: np.ndarray) -> np.ndarray:
    """Colour wheel: hue is the direction, saturation the length on a square-root scale."""
    length = np.hypot(flow_px[..., 0], flow_px[..., 1])
    hue = (np.arctan2(flow_px[..., 1], flow_px[..., 0]) / (2 * np.pi)) % 1.0
    strength = np.sqrt(np.clip(length / max(float(np.percentile(length, 98)), 1e-6), 0.0, 1.0))
    wheel = np.array([colorsys.hsv_to_rgb(h / 255.0, 1.0, 1.0) for h in range(256)])
    colour = wheel[(hue * 255).astype(np.uint8)]
    return ((1.0 - strength[..., None] * (1.0 - colour)) * 255).astype(np.uint8)


def events_rgb(events: np.ndarray, shape: tuple) -> np.ndarray:
    """Brighter is blue, darker is red, on dark grey."""
    pixels = np.full((*shape, 3), 24, np.uint8)
    up = events["polarity"] == 1
    pixels[events["y_px"][up], events["x_px"][up]] = (90, 150, 255)
    pixels[events["y_px"][~up], events["x_px"][~up]] = (255, 90, 70)
    return pixels


def scaled(pixels: np.ndarray, width: int) -> Image.Image:
    """Scales an image to a width in pixels."""
    image = Image.fromarray(np.ascontiguousarray(pixels))
    return image.resize((width, image.height * width // image.width), Image.Resampling.LANCZOS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", help="PNG to write")
    parser.add_argument("--sensor", default="ego/front", help="rig and sensor (default: %(default)s)")
    parser.add_argument("--domain", default="gantry")
    parser.add_argument("--after", type=float, default=0.0, help="simulated second to wait for")
    parser.add_argument("--width", type=int, default=480, help="width of one image in the sheet, pixels")
    args = parser.parse_args()
    topics = [f"{args.sensor}/{name}" for name in MODALITIES]
    with gantry.sync(topics, domain=args.domain, timeout=30.0) as ticks:
        row = next(row for row in ticks if row[topics[0]].sim_time >= args.after)
        rgb, depth, semantic, instance, flow, dvs = (row[topic] for topic in topics)
        images = [
            rgb.rgb.copy(),
            depth_rgb(depth.array),
            gantry.colour_classes(semantic.array),
            instance_rgb(instance.array),
            flow_rgb(flow.array),
            events_rgb(dvs.array, depth.array.shape),
        ]
        tick = rgb.tick
    tiles = [scaled(pixels, args.width) for pixels in images]
    gap = 4
    height = tiles[0].height
    sheet = Image.new("RGB", (3 * args.width + 2 * gap, 2 * height + gap), (255, 255, 255))
    for i, tile in enumerate(tiles):
        sheet.paste(tile, ((i % 3) * (args.width + gap), (i // 3) * (height + gap)))
    sheet.save(args.out)
    print(f"{args.out}: tick {tick}, {sheet.width} × {sheet.height}")


if __name__ == "__main__":
    main()
