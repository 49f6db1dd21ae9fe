"""Very many `listen()` calls in a world that runs freely. Arguments: port, number of calls."""

import sys
import threading

from carla_kit import connect, passed


def listens(world, n):
    """Each call connects anew and gets its first message."""
    blueprint = world.get_blueprint_library().find("sensor.other.imu")
    sensor = world.spawn_actor(blueprint, world.get_map().get_spawn_points()[0])
    for call in range(n):
        came = threading.Event()
        sensor.listen(lambda _: came.set())
        if call % 100 == 0:
            assert came.wait(60.0), f"call {call} of listen() gets nothing"
        sensor.stop()
    came = threading.Event()
    sensor.listen(lambda _: came.set())
    assert came.wait(60.0), "the last call of listen() gets nothing"
    sensor.destroy()


if __name__ == "__main__":
    listens(connect(sys.argv[1]).get_world(), int(sys.argv[2]))
    passed("listens")
