"""CARLA's stock client on a recording: it sees the world tick by tick, and cannot change anything.

Arguments: port of the gateway, recording.
"""

import sys

import carla
import gantry


def main():
    port, path = int(sys.argv[1]), sys.argv[2]
    client = carla.Client("127.0.0.1", port)
    client.set_timeout(60.0)
    world = client.get_world()
    drive = gantry.Recording(path)
    worlds = {snapshot.tick: snapshot for snapshot in drive.snapshots()}

    recorded = len(next(iter(worlds.values())).vehicles)
    assert len(world.get_actors().filter("vehicle.*")) == recorded, world.get_actors()
    n_compared = 0
    for _ in range(5):
        shown = world.wait_for_tick(60.0)
        for record in worlds[shown.frame].vehicles:
            place = shown.find(int(record["id"])).get_transform().location
            x, y, z = record["world_from_actor"]["translation_m"]
            assert max(abs(place.x - x), abs(place.y + y), abs(place.z - z)) < 1e-3, (shown.frame, place, (x, y, z))
            n_compared += 1
    assert n_compared, "vehicles were compared"
    print("world passed", flush=True)

    model = world.get_blueprint_library().find("vehicle.tesla.model3")
    try:
        world.spawn_actor(model, world.get_map().get_spawn_points()[0])
    except RuntimeError as refused:
        assert "this is a recording" in str(refused), refused
    else:
        raise AssertionError("a vehicle was spawned into a recording")
    print("refusal passed", flush=True)


main()
