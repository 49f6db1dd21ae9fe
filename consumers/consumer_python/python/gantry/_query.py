"""Ray casts against the world, and shapes drawn into its colour images."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._command import command


def cast_rays(from_m: Any, to_m: Any, *, all: bool = False, domain: str | None = None) -> list[list[dict[str, Any]]]:
    """Casts rays against the triangles that sensors see.

    `from_m` and `to_m` are positions in the world, metres, of shape (n, 3) or (3,); a single
    position counts for all rays. Returns for each ray a list of hits, nearest first:
    `{point_m, distance_m, normal, class, object_id}`, point and unit normal in the world. Without
    `all` a ray ends at its first hit. Raises `GantryError` if the simulator refuses.
    """
    start, end = np.broadcast_arrays(np.atleast_2d(np.asarray(from_m, float)), np.atleast_2d(np.asarray(to_m, float)))
    rays = [{"from_m": a.tolist(), "to_m": b.tolist()} for a, b in zip(start, end)]
    (reply,) = command({"do": "cast_rays", "rays": rays, "all": all}, domain=domain, timeout=30.0)
    hits: list[list[dict[str, Any]]] = reply["rays"]
    return hits


def draw(*shapes: dict[str, Any], rgb: tuple[int, int, int] = (255, 0, 0), seconds: float | None = None, domain: str | None = None) -> None:
    """Draws shapes into colour images; depth, labels and ray casts do not show them.

    Shapes are `point`, `line`, `arrow` and `box` of the command `draw_debug`, in the world, metres:
    `gantry.draw({"line": {"from_m": [0, 0, 1], "to_m": [5, 0, 1], "width_m": 0.1}})`. `rgb` is sRGB,
    0 to 255. They stay for `seconds` of simulated time, or without it until `clear_drawing`.
    """
    life = None if seconds is None else round(seconds * 1e9)
    command({"do": "draw_debug", "shapes": [{"draw": shape, "color_rgb": list(rgb), "life_nanos": life} for shape in shapes]}, domain=domain)


def clear_drawing(domain: str | None = None) -> None:
    """Removes all shapes that were drawn."""
    command({"do": "clear_debug"}, domain=domain)
