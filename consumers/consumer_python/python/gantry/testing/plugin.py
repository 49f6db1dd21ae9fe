"""pytest's fixture `simulator`. A project says `pytest_plugins = ["gantry.testing.plugin"]` in its `conftest.py`."""

from __future__ import annotations

from typing import Iterator

import pytest

from ._simulator import Simulator


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds `--gantry-bin`."""
    group = parser.getgroup("gantry")
    group.addoption("--gantry-bin", metavar="DIR", help="folder of Gantry's programs [default: beside gantry's native module, then PATH]")


def pytest_configure(config: pytest.Config) -> None:
    """Names the marker."""
    config.addinivalue_line(
        "markers",
        "gantry(launch, text=, set=, args=): what the fixture simulator runs; launch is relative to pytest's root folder [default: launch.toml]",
    )


@pytest.fixture
def simulator(request: pytest.FixtureRequest) -> Iterator[Simulator]:
    """A simulator of this test's own, which is stopped and checked at the end of the test.

    It runs `launch.toml` of pytest's root folder, or what the marker says:
    `@pytest.mark.gantry("other.toml", set={"scenario.seed": 3})`.
    """
    marker = request.node.get_closest_marker("gantry")
    args, options = ((), {}) if marker is None else (marker.args, dict(marker.kwargs))
    if "text" not in options:
        launch = options.pop("launch", args[0] if args else "launch.toml")
        args = (request.config.rootpath / launch,)
    options.setdefault("gantry_bin", request.config.getoption("--gantry-bin"))
    with Simulator(*args, **options) as running:
        try:
            yield running
        finally:
            # pytest shows it if the test fails.
            print(running.output)
