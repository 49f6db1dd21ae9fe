"""Vehicle controls, as records on `control/vehicles`."""

from __future__ import annotations

import math
import os
import struct
import threading
from typing import Any, Mapping

import numpy as np
import numpy.typing as npt

from ._domain import resolve
from ._dtypes import VEHICLE_CONTROL
from ._load import native

#: Bits of the field `flags`.
HAND_BRAKE, REVERSE, MANUAL_GEAR_SHIFT = 1, 2, 4
_LEAVE_LAMPS = 0xFFFFFFFF
_RECORD = struct.Struct("<I3fIiII")

_writers: dict[tuple[str, str], native.Controls] = {}
_ticks: dict[str, int] = {}
_lock = threading.Lock()


def note_tick(domain: str, tick: int) -> None:
    """Notes the tick that controls of this domain answer from now on."""
    _ticks[domain] = tick


def forget(domain: str) -> None:
    """Closes the writers of a domain that is left."""
    with _lock:
        _ticks.pop(domain, None)
        for key in [key for key in _writers if key[0] == domain]:
            del _writers[key]


def control_record(
    actor_id: int,
    *,
    throttle: float = 0.0,
    steer: float = 0.0,
    brake: float = 0.0,
    hand_brake: bool = False,
    reverse: bool = False,
    gear: int | None = None,
    lamps: int | None = None,
) -> bytes:
    """Returns one control as the 32 bytes of its record; arguments as those of `Vehicle.control`."""
    for name, value, low in (("throttle", throttle, 0.0), ("steer", steer, -1.0), ("brake", brake, 0.0)):
        if not (math.isfinite(value) and low <= value <= 1.0):
            raise ValueError(f"{name} is {value}; it must be a number from {low:g} to 1")
    if gear is not None and not -1 <= gear <= 20:
        raise ValueError(f"gear is {gear}; it must be -1 (reverse), 0 (neutral) or a forward gear up to 20")
    flags = HAND_BRAKE * hand_brake | REVERSE * reverse | MANUAL_GEAR_SHIFT * (gear is not None)
    return _RECORD.pack(actor_id, throttle, steer, brake, flags, gear or 0, _LEAVE_LAMPS if lamps is None else lamps, 0)


class Vehicle:
    """A vehicle that this program controls."""

    def __init__(self, actor_id: int, domain: str) -> None:
        #: Id of the actor.
        self.id: int = actor_id
        self._domain = domain

    def __repr__(self) -> str:
        return f"<gantry.Vehicle {self.id}>"

    def control(
        self,
        *,
        throttle: float = 0.0,
        steer: float = 0.0,
        brake: float = 0.0,
        hand_brake: bool = False,
        reverse: bool = False,
        gear: int | None = None,
        lamps: int | None = None,
        tick: int | None = None,
    ) -> None:
        """Sets pedals and steering; they hold until the next control, also if this program ends.

        `throttle` and `brake` are 0 to 1; `steer` is -1 to 1 as a share of the largest angle,
        positive to the left (CARLA's sign is the opposite). `gear` chooses the gear by hand (-1
        reverse, 0 neutral), None leaves it to the gearbox. `lamps` are the bits of
        `VehiclePart.lamps`, None leaves them alone. `tick` is the tick that this answers; the
        default is the last one of `lockstep`. The simulator applies it before its next tick.
        Raises `ValueError` for a value outside its range, `GantryError` if the bus fails.
        """
        record = control_record(
            self.id, throttle=throttle, steer=steer, brake=brake, hand_brake=hand_brake, reverse=reverse, gear=gear, lamps=lamps
        )
        _send(record, tick, self._domain, None)


def vehicle(actor: int | Any, domain: str | None = None) -> Vehicle:
    """Returns the vehicle with this actor id, or of this `carla.Vehicle`, to be controlled."""
    return Vehicle(int(getattr(actor, "id", actor)), resolve(domain))


def control(
    controls: Mapping[int, Mapping[str, Any]] | npt.NDArray[Any],
    *,
    tick: int | None = None,
    name: str | None = None,
    domain: str | None = None,
) -> None:
    """Controls many vehicles at once, in one sample.

    `controls` has the arguments of `Vehicle.control` by actor id, `{24: {"throttle": 0.5}}`, or is
    a structured array of `gantry.VEHICLE_CONTROL`. Of several controls for one vehicle between two
    ticks the last by (`name`, order) counts; the default name is `python-` and the process id.
    Raises as `Vehicle.control`.
    """
    if isinstance(controls, np.ndarray):
        if controls.dtype != VEHICLE_CONTROL:
            raise ValueError(f"controls have the type {controls.dtype}; make them with np.zeros(n, gantry.VEHICLE_CONTROL)")
        records = controls.tobytes()
    else:
        records = b"".join(control_record(actor_id, **values) for actor_id, values in controls.items())
    _send(records, tick, resolve(domain), name)


def _send(records: bytes, tick: int | None, domain: str, name: str | None) -> None:
    key = (domain, name or f"python-{os.getpid()}")
    writer = _writers.get(key)
    if writer is None:
        with _lock:
            writer = _writers.get(key) or _writers.setdefault(key, native.Controls(*key))
    writer.send(_ticks.get(domain, 0) if tick is None else tick, records)
