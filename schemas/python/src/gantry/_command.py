"""Commands to the simulator, as JSON over `control/world`."""

from __future__ import annotations

import ctypes
import itertools
import json
import os
import time
from typing import Any

import iceoryx2 as iox2
import numpy as np

from . import _bus, _layout
from ._dtypes import REQUEST_HEADER
from ._errors import GantryError

_seq = itertools.count(1)


def command(*commands: dict[str, Any], domain: str = "gantry", timeout: float = 5.0) -> list[dict[str, Any]]:
    """Sends commands, e.g. `gantry.command({"do": "step", "n": 1})`, and returns their replies.

    SPEC.md §7 lists commands and replies; there is one reply per command, in order. Raises
    `GantryError` without a simulator, after `timeout` seconds without an answer, and for a refused
    command, with the simulator's sentence; the commands before and after a refused one were done.
    """
    name = iox2.ServiceName.new(_bus.full_name("control/world", domain))
    config, pattern = iox2.config.global_config(), iox2.MessagingPattern.RequestResponse
    if iox2.Service.details(name, config, pattern, iox2.ServiceType.Ipc) is None:
        raise GantryError(f"no simulator answers on domain {domain!r}; start one with `gantry up`, or pass domain=")
    byte = iox2.Slice[ctypes.c_uint8]
    service = _bus.node().service_builder(name).request_response(byte, byte).request_header(_bus.HEADER_TYPES["RequestHeader"]).open()
    text = json.dumps({"v": _layout.COMMAND_VERSION, "commands": list(commands)}).encode()
    client = service.client_builder().initial_max_slice_len(len(text)).create()
    replied = _bus.event("control/replied", domain).listener_builder().create()
    try:
        request = client.loan_slice_uninit(len(text))
        ctypes.memmove(request.payload_ptr, text, len(text))
        header = np.zeros((), REQUEST_HEADER)
        header["magic"], header["codec_version"] = _layout.REQUEST_MAGIC, _layout.COMMAND_VERSION
        header["seq"], header["payload_bytes"] = next(_seq), len(text)
        client_name = f"python-{os.getpid()}".encode()
        header["client"][: len(client_name)] = np.frombuffer(client_name, np.uint8)
        ctypes.memmove(request.user_header_ptr, header.tobytes(), REQUEST_HEADER.itemsize)
        pending = request.assume_init().send()
        _bus.wake_daemon(domain)
        answer = _wait(pending, replied, timeout)
    finally:
        replied.delete()
        client.delete()
    for reply in answer["replies"]:
        if reply.get("is") == "refused":
            raise GantryError(f"the simulator refused: {reply['error']}")
    return answer["replies"]


def _wait(pending: Any, replied: Any, timeout: float) -> dict[str, Any]:
    deadline = time.monotonic() + timeout
    while True:
        response = pending.receive()
        if response is not None:
            return json.loads(bytes(response.payload().as_memory_view()))
        if time.monotonic() >= deadline:
            raise GantryError(f"the simulator did not answer within {timeout} s; it may be loading a map or have stopped")
        replied.timed_wait(iox2.Duration.from_millis(50))
