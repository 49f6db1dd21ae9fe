"""Checkpoints: save the world, go back to it, start the episode over."""

from __future__ import annotations

from ._command import command


def save_checkpoint(*, name: str | None = None, file: str | None = None, domain: str = "gantry") -> str:
    """Saves the whole world, in the simulator's memory under `name` or in `file` of its data folder. Returns the file's path, or "".

    A restored run goes on bit for bit. `docs/checkpoints.md` says what is in a checkpoint and what is not.
    """
    (reply,) = command({"do": "save_checkpoint", "to": _place(name, file)}, domain=domain, timeout=30.0)
    return reply["path"]


def restore_checkpoint(*, name: str | None = None, file: str | None = None, domain: str = "gantry") -> list[int]:
    """Goes back to a checkpoint. The tick goes on; sensors stay. Returns the sensors that went because what carried them does not exist there."""
    (reply,) = command({"do": "restore_checkpoint", "from": _place(name, file)}, domain=domain, timeout=30.0)
    return reply["gone"]


def reset(domain: str = "gantry") -> list[int]:
    """Goes back to the start of the episode. Returns as `restore_checkpoint`."""
    (reply,) = command({"do": "reset"}, domain=domain, timeout=30.0)
    return reply["gone"]


def _place(name: str | None, file: str | None) -> dict[str, str]:
    if (name is None) == (file is None):
        raise ValueError("say either name= (in memory) or file= (in the data folder)")
    return {"name": name} if name is not None else {"file": str(file)}
