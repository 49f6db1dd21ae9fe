"""Publishes boxes round the cars that the front camera sees, for every image: python -m {{name}}."""

import contextlib

import gantry

from .detect import cars

#: What is read. A detector of your own reads ego/front/rgb: `frame.rgb` is an array (h, w, 3).
CAMERA = "ego/front/semantic"
#: What is published; `gantry topic hz` and the viewer show it by this name.
BOXES = "{{name}}/boxes"


def main() -> None:
    """Runs until Ctrl-C or the launcher's end; waits for a simulator that is not there yet."""
    with (
        contextlib.suppress(KeyboardInterrupt),
        gantry.publish(BOXES, "boxes2d") as boxes,
        gantry.open(CAMERA, timeout=600) as camera,
    ):
        # Every image in order; `camera.latest()` skips those that came while this program was busy.
        for frame in camera:
            # Naming the image makes latency measurable, and places the boxes in the viewer.
            boxes.send(cars(frame.array), answers=frame)


if __name__ == "__main__":
    main()
