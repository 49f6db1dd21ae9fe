"""iceoryx2 for this package: one node per process, services by name, errors as sentences."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any, Optional

import iceoryx2 as iox2

from . import _layout
from ._errors import BorrowLimitError, GantryError, NoSuchTopicError, SchemaVersionError, TooManyReadersError

_node: Optional[Any] = None


def node() -> Any:
    """Returns this process's node, which the first call makes.

    The node handles no signals, so that Ctrl-C raises KeyboardInterrupt.
    """
    global _node
    if _node is None:
        iox2.set_log_level(iox2.LogLevel.Fatal)
        try:
            builder = iox2.NodeBuilder.new().name(iox2.NodeName.new("python"))
            _node = builder.signal_handling_mode(iox2.SignalHandlingMode.Disabled).create(iox2.ServiceType.Ipc)
        except Exception as cause:
            raise GantryError(f"cannot join the shared-memory bus ({cause}); check that /dev/shm is writable") from cause
    return _node


def _header_type(name: str) -> type:
    """A ctypes struct with the name and size that iceoryx2 compares."""
    on_bus, size, _ = _layout.STRUCTS[name]
    fields = {"_fields_": [("raw", ctypes.c_uint8 * size)], "type_name": staticmethod(lambda: on_bus)}
    return type(on_bus, (ctypes.Structure,), fields)


HEADER_TYPES: dict[str, type] = {name: _header_type(name) for name, (on_bus, _, _) in _layout.STRUCTS.items() if on_bus}
_KINDS = {
    on_bus: name for name, (on_bus, _, _) in _layout.STRUCTS.items()
    if name in ("FrameHeader", "SnapshotHeader", "DocumentHeader", "ControlHeader")
}


def full_name(topic: str, domain: str) -> str:
    """Returns `<domain>/<topic>`; a topic that already starts with the domain stays as it is."""
    return topic if topic.startswith(domain + "/") else f"{domain}/{topic}"


def _schema(details: Any) -> str:
    values = details.attributes().key_values(iox2.AttributeKey.new(_layout.SCHEMA_ATTRIBUTE))
    return values[0].to_string() if values else ""


def open_slices(topic: str, domain: str, header: str) -> Any:
    """Opens a publish-subscribe service of byte slices, whose schema is checked first.

    Raises `NoSuchTopicError` if there is none, `SchemaVersionError` for another schema.
    """
    full = full_name(topic, domain)
    try:
        name = iox2.ServiceName.new(full)
    except Exception as cause:
        raise GantryError(f"topic {full!r} is not a usable name") from cause
    details = iox2.Service.details(name, iox2.config.global_config(), iox2.MessagingPattern.PublishSubscribe, iox2.ServiceType.Ipc)
    if details is None:
        raise NoSuchTopicError(_no_such_topic(full, domain))
    schema = _schema(details)
    if schema != str(_layout.SCHEMA_VERSION):
        raise SchemaVersionError(
            f"cannot join service {full!r}: it carries schema {schema or 'none'}, this package reads {_layout.SCHEMA_VERSION}; "
            "install the gantry package of the simulator's version"
        )
    builder = node().service_builder(name).publish_subscribe(iox2.Slice[ctypes.c_uint8])
    try:
        return builder.user_header(HEADER_TYPES[header]).open()
    except iox2.PublishSubscribeOpenError as cause:
        if "DoesNotExist" in str(cause):
            raise NoSuchTopicError(_no_such_topic(full, domain)) from cause
        raise GantryError(f"cannot open service {full!r} ({cause}); if a process was killed a moment ago, try again") from cause


def subscribe(service: Any, full: str) -> Any:
    """Opens a reading port. Raises `TooManyReadersError` if the service has no place left."""
    try:
        return service.subscriber_builder().create()
    except iox2.SubscriberCreateError as cause:
        if "ExceedsMaxSupportedSubscribers" in str(cause):
            limit = service.static_config.max_subscribers
            raise TooManyReadersError(
                f"service {full!r} already has {limit} readers (limit {limit}); stop one before another can join"
            ) from cause
        raise GantryError(f"cannot read service {full!r} ({cause})") from cause


def receive(port: Any, full: str, limit: int) -> Optional[Any]:
    """Takes one sample, or returns None if none waits.

    Raises `BorrowLimitError` if the reader already holds `limit` samples.
    """
    try:
        return port.receive()
    except iox2.ReceiveError as cause:
        if "ExceedsMaxBorrows" in str(cause):
            raise BorrowLimitError(
                f"cannot take another frame of {full!r}: this reader already holds {limit} (limit {limit}); "
                "frames and arrays made from them keep shared memory borrowed: keep frame.copy() instead"
            ) from cause
        raise GantryError(f"cannot read service {full!r} ({cause})") from cause


def header_bytes(sample: Any, header: str) -> bytes:
    """Returns a copy of the sample's user header."""
    return ctypes.string_at(sample.user_header_ptr, _layout.STRUCTS[header][1])


_FrameHeaderMemory = ctypes.c_uint8 * _layout.STRUCTS["FrameHeader"][1]


def frame_header_memory(sample: Any) -> Any:
    """Returns the bytes of a frame's header in place, valid as long as `sample` is.

    Unlike `header_bytes`, this costs no call through libffi, which a woken reader would wait for.
    """
    return _FrameHeaderMemory.from_address(sample.user_header_ptr)


def event(topic: str, domain: str) -> Any:
    """Opens or makes an event service, with the capacities of SPEC.md §2."""
    name = iox2.ServiceName.new(full_name(topic, domain))
    return node().service_builder(name).event().max_listeners(32).max_notifiers(32).max_nodes(64).open_or_create()


def wake_daemon(domain: str) -> None:
    """Notifies `control/wake`, so that the daemon sends the latest samples to new readers."""
    event("control/wake", domain).notifier_builder().create().notify()


@dataclass(frozen=True)
class TopicDetails:
    """One topic of a domain."""

    #: Name without the domain.
    name: str
    #: `frame`, `snapshot`, `document`, `control` or `other`.
    kind: str
    #: Modality of a frame topic, otherwise None.
    modality: Optional[str]
    #: Number of writers.
    publishers: int
    #: Number of readers.
    subscribers: int
    #: Schema version that the topic carries.
    schema: str


def topics(domain: str = "gantry") -> list[TopicDetails]:
    """Lists all topics of the domain, sorted by name."""
    found = []
    names = {modality[0] for modality in _layout.MODALITIES.values()}
    for details in iox2.Service.list(iox2.config.global_config(), iox2.ServiceType.Ipc):
        full = details.name().to_string()
        schema = _schema(details)
        if not full.startswith(domain + "/") or not schema or details.messaging_pattern() != iox2.MessagingPattern.PublishSubscribe:
            continue
        name = full[len(domain) + 1:]
        last = name.rsplit("/", 1)[-1]
        kind, publishers, subscribers = "other", 0, 0
        for header in _KINDS.values():
            try:
                builder = node().service_builder(iox2.ServiceName.new(full)).publish_subscribe(iox2.Slice[ctypes.c_uint8])
                ports = builder.user_header(HEADER_TYPES[header]).open().dynamic_config
            except iox2.PublishSubscribeOpenError:
                continue
            kind, publishers, subscribers = header.replace("Header", "").lower(), ports.number_of_publishers, ports.number_of_subscribers
            break
        modality = last if kind == "frame" and last in names else None
        found.append(TopicDetails(name, kind, modality, publishers, subscribers, schema))
    return sorted(found, key=lambda topic: topic.name)


def _no_such_topic(full: str, domain: str) -> str:
    names = [topic.name for topic in topics(domain)]
    if not names:
        return f"there is no topic {full!r}: nothing runs on domain {domain!r}; start the simulator with `gantry up`, or pass domain="
    last = full.rsplit("/", 1)[-1]
    near = [name for name in names if name.endswith(last)] or names
    return f"there is no topic {full!r}; there is {', '.join(near[:12])}"
