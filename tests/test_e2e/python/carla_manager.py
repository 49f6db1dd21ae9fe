"""Gantry's own Traffic Manager behind the stock `carla` 0.9.16 wheel: `gantry-drive --serve` on the domain of gantry-carla.

    carla_manager.py PORT TM_PORT THEME…

Themes: calls, batch, free, repeat, other (a second client), own (nobody serves, the client drives), and
settle, witness, after, between which the test kills the manager and starts another.
Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import inspect
import pathlib
import subprocess
import sys
import time

import carla
from carla_kit import connect, passed, run, speed, step_by_hand, ticks

PORT, TM_PORT = int(sys.argv[1]), int(sys.argv[2])
SpawnActor, SetAutopilot, FutureActor = carla.command.SpawnActor, carla.command.SetAutopilot, carla.command.FutureActor


def stage(stepped=True):
    """A client, its world without vehicles, and the manager at the port."""
    client = connect(PORT)
    world = client.get_world()
    step_by_hand(world, synchronous_mode=stepped)
    for car in world.get_actors().filter("vehicle.*"):
        car.destroy()
    manager = client.get_trafficmanager(TM_PORT)
    assert manager.get_port() == TM_PORT
    if stepped:
        manager.set_synchronous_mode(True)
        world.tick()
    return client, world, manager


def spawn(client, world, n, first=0, stepped=True):
    """Cars in one batch, on autopilot before any snapshot shows them."""
    blueprint = world.get_blueprint_library().find("vehicle.tesla.model3")
    blueprint.set_attribute("role_name", "autopilot")
    points = world.get_map().get_spawn_points()[first:first + n]
    batch = [SpawnActor(blueprint, point).then(SetAutopilot(FutureActor, True, TM_PORT)) for point in points]
    answers = client.apply_batch_sync(batch, stepped)
    assert not any(answer.error for answer in answers), [answer.error for answer in answers]
    return actors(world, [answer.actor_id for answer in answers]) if stepped else [answer.actor_id for answer in answers]


def actors(world, ids):
    """Handles, once a snapshot shows them all."""
    found = [world.get_actor(number) for number in ids]
    assert all(found), ids
    return found


def places(cars):
    return {car.id: car.get_location() for car in cars}


def n_moved(before, cars, least_m=1.0):
    return sum(before[car.id].distance(car.get_location()) > least_m for car in cars)


def check_calls():
    """Every method of the client's class is answered, and what is set acts."""
    client, world, manager = stage()
    first, second = spawn(client, world, 2)
    here = first.get_location()
    given = {
        "auto_lane_change": (first, False),
        "collision_detection": (first, second, False),
        "distance_to_leading_vehicle": (first, 3.0),
        "force_lane_change": (first, True),
        "get_all_actions": (first,),
        "get_next_action": (first,),
        "get_port": (),
        "global_lane_offset": (0.0,),
        "global_percentage_speed_difference": (0.0,),
        "ignore_lights_percentage": (first, 100.0),
        "ignore_signs_percentage": (first, 100.0),
        "ignore_vehicles_percentage": (first, 0.0),
        "ignore_walkers_percentage": (first, 0.0),
        "keep_right_rule_percentage": (first, 0.0),
        "keep_slow_lane_rule_percentage": (first, 0.0),
        "random_left_lanechange_percentage": (first, 0.0),
        "random_right_lanechange_percentage": (first, 0.0),
        "set_boundaries_respawn_dormant_vehicles": (25.0, 700.0),
        "set_desired_speed": (first, 30.0),
        "set_global_distance_to_leading_vehicle": (2.5,),
        "set_hybrid_physics_mode": (False,),
        "set_hybrid_physics_radius": (70.0,),
        "set_osm_mode": (True,),
        "set_path": (second, [here]),
        "set_random_device_seed": (7,),
        "set_respawn_dormant_vehicles": (False,),
        "set_route": (second, ["Left", "Right", "Straight"]),
        "set_synchronous_mode": (True,),
        "shut_down": (),
        "update_vehicle_lights": (second, True),
        "vehicle_lane_offset": (first, 0.0),
        "vehicle_percentage_speed_difference": (second, 50.0),
    }
    methods = [name for name, _ in inspect.getmembers(carla.TrafficManager, callable) if not name.startswith("_")]
    missing = [name for name in methods if name not in given]
    assert not missing, f"{missing} are not called"
    for name in methods:
        if name != "shut_down":
            getattr(manager, name)(*given[name])
    before = places([first, second])
    ticks(world, 100)
    assert n_moved(before, [first]) == 1, first.get_location()
    first.set_autopilot(False, TM_PORT)
    manager.shut_down()
    ticks(world, 100)
    assert speed(second) < 0.1, f"after the shut-down it stands, not {speed(second)} m/s"


def check_batch():
    """`SetAutopilot(FutureActor)` in a batch of a stepped world: everybody drives."""
    client, world, manager = stage()
    cars = spawn(client, world, 8)
    for car in cars:
        manager.ignore_lights_percentage(car, 100.0)
    before = places(cars)
    ticks(world, 200)
    assert n_moved(before, cars) >= 7, n_moved(before, cars)
    manager.shut_down()


def check_free():
    """The same while the world runs by itself, and with `set_autopilot` right after `spawn_actor`."""
    client, world, manager = stage(stepped=False)
    ids = spawn(client, world, 6, stepped=False)
    for _ in range(3):
        world.wait_for_tick(60.0)
    cars = actors(world, ids)
    blueprint = world.get_blueprint_library().find("vehicle.audi.tt")
    single = world.spawn_actor(blueprint, world.get_map().get_spawn_points()[20])
    single.set_autopilot(True, TM_PORT)
    for car in [*cars, single]:
        manager.ignore_lights_percentage(car, 100.0)
    before, until = None, time.monotonic() + 60.0
    while time.monotonic() < until:
        world.wait_for_tick(60.0)
        before = before or places([*cars, single])
        if n_moved(before, [*cars, single]) == 7:
            break
    assert n_moved(before, [*cars, single]) >= 6 and n_moved(before, [single]) == 1, n_moved(before, [*cars, single])
    manager.shut_down()


def drive(seed):
    """Where six cars are in each of 200 ticks after a new beginning."""
    client = connect(PORT)
    client.reload_world(False)
    client, world, manager = stage()
    manager.set_random_device_seed(seed)
    cars, way = spawn(client, world, 6), []
    for number, car in enumerate(cars):
        manager.vehicle_percentage_speed_difference(car, 10.0 * number - 20.0)
    for _ in range(200):
        frame = world.tick()
        seen = world.get_snapshot()
        assert seen.frame == frame
        way.append([str(seen.find(car.id).get_transform()) for car in cars])
    manager.shut_down()
    return way


def check_repeat():
    """The same seed gives the same places in every tick."""
    first, again = drive(7), drive(7)
    differing = next((n for n, (a, b) in enumerate(zip(first, again)) if a != b), None)
    assert differing is None, f"tick {differing}: {first[differing]} and {again[differing]}"


def check_other():
    """Two client processes have cars with the same manager at once; what one sets for its car does not touch the other's."""
    client, world, manager = stage()
    mine = spawn(client, world, 3)
    with subprocess.Popen([sys.executable, __file__, str(PORT), str(TM_PORT), "guest"], stdout=subprocess.PIPE, text=True) as guest:
        line = guest.stdout.readline()
        assert line.startswith("ready"), line
        world.tick()
        theirs = actors(world, [int(word) for word in line.split()[1:]])
        assert len(theirs) == 3, line
        for car in [*mine, *theirs]:
            manager.ignore_lights_percentage(car, 100.0)
        before = places([*mine, *theirs])
        ticks(world, 150)
        assert n_moved(before, mine) >= 2 and n_moved(before, theirs) >= 2, (n_moved(before, mine), n_moved(before, theirs))
        guest.terminate()
    before = places(theirs)
    ticks(world, 150)
    assert n_moved(before, theirs) >= 2, "who drives goes on driving when its client has gone"
    manager.shut_down()


def check_guest():
    client = connect(PORT)
    world = client.get_world()
    client.get_trafficmanager(TM_PORT)
    print("ready", *spawn(client, world, 3, first=30, stepped=False), flush=True)
    time.sleep(600.0)


def check_settle():
    """Cars that drive on when this client goes."""
    client, world, manager = stage()
    cars = spawn(client, world, 5)
    for car in cars:
        manager.ignore_lights_percentage(car, 100.0)
    before = places(cars)
    ticks(world, 60)
    assert n_moved(before, cars) >= 4, n_moved(before, cars)


def check_witness():
    """A client without a manager goes on stepping while that is killed: no step waits for the dead."""
    world = connect(PORT).get_world()
    gone = pathlib.Path.home() / "gone"
    ticks(world, 5)
    print("stepping", flush=True)
    while not gone.exists():
        world.tick()
    ticks(world, 30)


def check_bereaved():
    """A client whose manager is killed loses the world for no longer than a moment: no tick runs into its time-out."""
    client = connect(PORT, timeout_secs=60.0)
    world = client.get_world()
    step_by_hand(world)
    manager = client.get_trafficmanager(TM_PORT)
    manager.set_synchronous_mode(True)
    gone = pathlib.Path.home() / "gone"
    ticks(world, 5)
    print("stepping", flush=True)
    while not gone.exists():
        world.tick()
    # The package notices within 4 s, and then takes an error in the place of a snapshot.
    until = time.monotonic() + 6.0
    while time.monotonic() < until:
        before = time.monotonic()
        world.tick()
        assert time.monotonic() - before < 50.0


def check_after():
    """A new client finds the cars that its successor drives on."""
    client = connect(PORT)
    world = client.get_world()
    world.tick()
    cars = list(world.get_actors().filter("vehicle.*"))
    before = places(cars)
    ticks(world, 200)
    assert len(cars) == 5 and n_moved(before, cars) >= 4, n_moved(before, cars)
    client.get_trafficmanager(TM_PORT).shut_down()


def check_own():
    """Where nobody serves, the client drives by itself as ever."""
    client, world, manager = stage()
    cars = spawn(client, world, 2)
    before = places(cars)
    ticks(world, 150)
    assert n_moved(before, cars) >= 1
    manager.set_synchronous_mode(False)
    manager.shut_down()


def main():
    for theme in sys.argv[3:]:
        globals()[f"check_{theme}"]()
        passed(theme)


run(main)
