"""Errors of this package. Each message says what failed and what to do."""

from __future__ import annotations


class GantryError(Exception):
    """Base of all errors of this package."""


class NoSuchTopicError(GantryError):
    """No process has made the topic."""


class SchemaVersionError(GantryError):
    """The publisher uses another version of the layouts."""


class TooManyReadersError(GantryError):
    """The topic has as many readers as it allows."""


class TopicTakenError(GantryError):
    """Another process writes the topic; a topic has one writer."""


class BorrowLimitError(GantryError):
    """The reader holds as many frames as it may; drop one, or keep copies."""


class TimedOutError(GantryError, TimeoutError):
    """What was waited for did not come in time."""


class FrameFormatError(GantryError):
    """A frame, a result or another sample breaks the contract of SPEC.md."""
