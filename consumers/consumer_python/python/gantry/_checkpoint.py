"""Checkpoints: saving the world, returning to it, and restarting the episode."""

from __future__ import annotations

from ._command import command


def save_checkpoint(*, name: str | None = None, file: str | None = None, domain: str | None = None) -> str:
    """Saves the world: under `name` in the simulator's memory, or in `file` of its data folder.

    Returns the path of the file, or "". A restored run continues bit for bit;
    `docs/how-to/checkpoints.md` says what a checkpoint contains. Raises `GantryError` if the simulator
    refuses, `ValueError` unless exactly one of `name` and `file` is given.
    """
    (reply,) = command({"do": "save_checkpoint", "to": _place(name, file)}, domain=domain, timeout=30.0)
    path: str = reply["path"]
    return path


def restore_checkpoint(*, name: str | None = None, file: str | None = None, domain: str | None = None) -> list[int]:
    """Returns to a checkpoint. The count of ticks goes on, and sensors stay.

    Returns the ids of sensors that were removed because their parent does not exist in the
    checkpoint. Raises as `save_checkpoint`.
    """
    (reply,) = command({"do": "restore_checkpoint", "from": _place(name, file)}, domain=domain, timeout=30.0)
    gone: list[int] = reply["gone"]
    return gone


def reset(domain: str | None = None) -> list[int]:
    """Returns to the start of the episode; result and errors are those of `restore_checkpoint`."""
    (reply,) = command({"do": "reset"}, domain=domain, timeout=30.0)
    gone: list[int] = reply["gone"]
    return gone


def _place(name: str | None, file: str | None) -> dict[str, str]:
    if (name is None) == (file is None):
        raise ValueError("say either name= (in memory) or file= (in the data folder)")
    return {"name": name} if name is not None else {"file": str(file)}
