"""Domains: which simulator is meant."""

from __future__ import annotations

from ._load import native


#: Domains of simulators that `gantry.testing` has started, the newest last.
sandboxes: list[str] = []


def resolve(domain: str | None) -> str:
    """Returns `domain`; None stands for a test's sandbox, else the environment's `GANTRY_DOMAIN`, or else `gantry`."""
    if domain is not None:
        return domain
    return sandboxes[-1] if sandboxes else native.default_domain()


def split(topic: str, domain: str | None) -> tuple[str, str]:
    """Returns (domain, topic without the domain); a topic may begin with its domain."""
    domain = resolve(domain)
    return domain, topic.removeprefix(domain + "/")
