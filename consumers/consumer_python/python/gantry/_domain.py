"""Domains: which simulator is meant."""

from __future__ import annotations

from ._load import native


def resolve(domain: str | None) -> str:
    """Returns `domain`; None stands for the environment's `GANTRY_DOMAIN`, or else `gantry`."""
    return native.default_domain() if domain is None else domain


def split(topic: str, domain: str | None) -> tuple[str, str]:
    """Returns (domain, topic without the domain); a topic may begin with its domain."""
    domain = resolve(domain)
    return domain, topic.removeprefix(domain + "/")
