"""The program as a process beside a simulator, both in a domain and shared memory of their own."""

import pathlib
import sys

import numpy as np
import pytest

PROJECT = pathlib.Path(__file__).resolve().parents[1]
#: Without traffic, and with the numbers of the objects in the image.
SCENE = {
    "scenario.vehicles": 0,
    "sensor.front.modalities": ["semantic", "instance"],
    "sensor.front.width_px": 320,
    "sensor.front.height_px": 240,
}


@pytest.mark.gantry(PROJECT / "launch.toml", set=SCENE)
def test_every_image_is_answered_and_the_car_ahead_has_an_exact_box(simulator):
    car = simulator.spawn_near_ego("vehicle.audi.tt", (12.0, 0.0, 0.3))
    simulator.run(sys.executable, "-m", "{{name}}", cwd=PROJECT)
    simulator.watch("{{name}}/boxes", "ego/front/instance")
    simulator.wait_readers("ego/front/semantic", 1)
    for _ in range(5):
        tick = simulator.step()
        result = simulator.result("{{name}}/boxes", tick)
        assert [(it.topic, it.tick) for it in result.inputs] == [("ego/front/semantic", tick)]

        # The box of the car's own pixels, from another picture of the same tick.
        rows, columns = np.nonzero(simulator.frame("ego/front/instance", tick).array == car)
        low, high = [columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]
        found = list(zip(result.array["min_px"].tolist(), result.array["max_px"].tolist()))
        assert (low, high) in found
