"""What can go wrong, as sentences."""

from __future__ import annotations


class GantryError(Exception):
    """Base of all errors of this package."""


class NoSuchTopicError(GantryError):
    """Nobody publishes the topic."""


class SchemaVersionError(GantryError):
    """The publisher speaks another version of the layouts."""


class TooManyReadersError(GantryError):
    """All reader places of the topic are taken."""


class BorrowLimitError(GantryError):
    """This reader holds all the frames it may."""


class FrameFormatError(GantryError):
    """A frame breaks the contract of SPEC.md."""
