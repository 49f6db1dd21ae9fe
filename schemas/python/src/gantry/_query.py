"""Questions to the world's geometry, and drawing into its pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._command import command


def cast_rays(from_m: Any, to_m: Any, *, all: bool = False, domain: str = "gantry") -> list[list[dict[str, Any]]]:
    """What rays from `from_m` to `to_m` meet: arrays of shape (n, 3), metres, world; one row for all or one per ray.

    The triangles are those that sensors see. Per ray a list of `{point_m, distance_m, normal, class, object_id}`, nearest first; at most
    one without `all`, which goes on through what it meets.
    """
    start, end = np.broadcast_arrays(np.atleast_2d(np.asarray(from_m, float)), np.atleast_2d(np.asarray(to_m, float)))
    rays = [{"from_m": a.tolist(), "to_m": b.tolist()} for a, b in zip(start, end)]
    (reply,) = command({"do": "cast_rays", "rays": rays, "all": all}, domain=domain, timeout=30.0)
    return reply["rays"]


def draw(*shapes: dict[str, Any], rgb: tuple[int, int, int] = (255, 0, 0), seconds: float | None = None, domain: str = "gantry") -> None:
    """Draws into colour pictures, e.g. `gantry.draw({"line": {"from_m": [0, 0, 1], "to_m": [5, 0, 1], "width_m": 0.1}})`.

    Shapes are `point`, `line`, `arrow` and `box` of the command `draw_debug`. They are seen for `seconds` of simulated time, until
    `clear_drawing` without it. Depth, labels and rays never see them.
    """
    life = None if seconds is None else round(seconds * 1e9)
    command({"do": "draw_debug", "shapes": [{"draw": shape, "color_rgb": list(rgb), "life_nanos": life} for shape in shapes]}, domain=domain)


def clear_drawing(domain: str = "gantry") -> None:
    """Removes everything that was drawn."""
    command({"do": "clear_debug"}, domain=domain)
