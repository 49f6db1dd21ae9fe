"""Tests of programs that use gantry: a simulator in a sandbox, which steps, runs programs and hands out frames.

    with Simulator("launch.toml", set={"scenario.vehicles": 0}) as simulator:
        program = simulator.run(sys.executable, "-m", "my_detector")
        simulator.watch("ego/front/semantic", "my_detector/boxes")
        tick = simulator.step(3)
        boxes = simulator.result("my_detector/boxes", tick).array

The simulator runs in a domain, a folder and a part of `/dev/shm` of its own, so that tests can run
side by side and beside a simulator in use. Within the block its domain is the default of all of
gantry's functions. At the end everything is stopped, and files that are left in shared memory are
an error. `gantry.testing.plugin` makes it a fixture of pytest.
"""

from ._program import PATIENCE_SECS, Program
from ._simulator import Simulator

__all__ = ["PATIENCE_SECS", "Program", "Simulator"]
