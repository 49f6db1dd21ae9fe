"""Logging into the view that `gantry-view` shows, with rerun's own package."""

from __future__ import annotations

import json
import warnings
from typing import Any

from ._errors import GantryError, NoSuchTopicError
from ._patience import PATIENCE
from ._world import document

#: Document in which a viewer says where its view is.
_VIEW = "control/view"


def rerun(domain: str | None = None, timeout: float = PATIENCE) -> Any:
    """Returns a `rerun.RecordingStream` that logs into the recording that `gantry-view` shows.

    Its timelines are `tick` and `sim_time`: set them to those of what you log about, and it stands
    beside the frame. Everything below `/world` is in the view of the world, what is below a camera's
    image, such as `/world/ego/front/rgb/mine`, on that image. After a restart of the simulator, which
    begins a new recording, call it again. Needs the package `rerun-sdk`.

    Raises `GantryError` if the package is missing, or no viewer with a window or a page tells where it
    is within `timeout` seconds.

    >>> stream = gantry.rerun()                                              # doctest: +SKIP
    >>> stream.set_time("tick", sequence=frame.tick)                         # doctest: +SKIP
    >>> stream.log("world/ego/front/rgb/mine", rr.Points2D([[400, 300]]))    # doctest: +SKIP
    """
    try:
        import rerun as rr
    except ImportError as error:
        raise GantryError("the package rerun-sdk is not installed; `pip install 'gantry-sim[programs]'` brings it") from error
    try:
        place = json.loads(document(_VIEW, domain=domain, timeout=timeout).text)
    except NoSuchTopicError as error:
        raise GantryError("no viewer tells where it is; start `gantry view --web` or `--native` first (a file cannot be joined)") from error
    theirs, ours = str(place["rerun_version"]), str(rr.__version__)
    if theirs.split(".")[:2] != ours.split(".")[:2]:
        warnings.warn(f"the viewer is rerun {theirs}, this package {ours}; `pip install rerun-sdk=={theirs}` if nothing is seen", stacklevel=2)
    stream = rr.RecordingStream(place["application_id"], recording_id=place["recording_id"], send_properties=False)
    stream.connect_grpc(place["url"])
    return stream
