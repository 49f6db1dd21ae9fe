"""What a script does at awkward moments of the wheel's own Traffic Manager, through the stock `carla` 0.9.16 wheel against gantry-carla.

    carla_managers.py PORT TM_PORT

The manager's thread runs beside the script and looks at the world when it likes: a vehicle that it does not find in its frame is never
driven, a world that is loaded under it ends the process, and without a reset it drives by the map of before.
Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import sys

import carla

from carla_kit import connect, passed, run, run_checks, shut_down, step_by_hand, synchronous_manager, ticks

PORT, TM_PORT = int(sys.argv[1]), int(sys.argv[2])
N_NEWBORN, N_CARS = 12, 6


def check_newborn(client):
    """A manager that runs by itself drives a car that it was given before a snapshot had it; its loss would be for good."""
    world = client.get_world()
    before = step_by_hand(world)
    blueprint = world.get_blueprint_library().find("vehicle.lincoln.mkz_2020")
    points = world.get_map().get_spawn_points()
    # A red light may be close ahead.
    for light in world.get_actors().filter("traffic.traffic_light"):
        light.set_state(carla.TrafficLightState.Green)
        light.freeze(True)
    for n in range(N_NEWBORN):
        car = world.spawn_actor(blueprint, points[n])
        # The first one makes the manager, too.
        car.set_autopilot(True, TM_PORT)
        ticks(world, 3)
        start = car.get_location()
        ticks(world, 60)
        way_m = car.get_location().distance_2d(start)
        # Destroyed right after a tick, while the manager works on it.
        world.tick()
        car.destroy()
        # One that is not driven stays where it is; one that waits for a turn at a junction moves little.
        assert way_m > 1.0, f"car {n} has moved {way_m:.1f} m"
    world.apply_settings(before)
    client.get_trafficmanager(TM_PORT).shut_down()


def drive_in_towns(client, manager, is_stepped, towns):
    """Loads towns one after the other; in each, cars keep to its lanes."""
    for town in towns:
        world = client.load_world(town)
        if is_stepped:
            step_by_hand(world)
        blueprint = world.get_blueprint_library().find("vehicle.audi.a2")
        world_map, cars = world.get_map(), []
        assert world_map.name.endswith(town), world_map.name
        for point in world_map.get_spawn_points()[:N_CARS]:
            car = world.try_spawn_actor(blueprint, point)
            if car:
                car.set_autopilot(True, manager.get_port())
                manager.ignore_lights_percentage(car, 100)
                cars.append((car, point.location))
        for _ in range(100):
            world.tick() if is_stepped else world.wait_for_tick(60.0)
        places = [(car.get_location(), start) for car, start in cars]
        ways_m = [at.distance_2d(start) for at, start in places]
        aside_m = [at.distance_2d(world_map.get_waypoint(at).transform.location) for at, _ in places]
        assert len(cars) > 2 and max(ways_m) > 10.0, (town, ways_m)
        # A car in the middle of a lane change is half a lane aside.
        assert max(aside_m) < 2.0, f"{town}: the manager drives by another map, {aside_m} m beside the lanes"


def check_free_worlds(client):
    """The manager runs by itself while the script loads towns."""
    manager = client.get_trafficmanager(TM_PORT + 1)
    drive_in_towns(client, manager, False, ["Town01", "Town02", "Town01", "Town10HD"])
    manager.shut_down()


def check_stepped_worlds(client):
    """The manager steps with the script."""
    manager = synchronous_manager(client, TM_PORT + 2)
    drive_in_towns(client, manager, True, ["Town02", "Town01", "Town02"])
    shut_down(manager)


def main():
    client = connect(PORT)
    for vehicle in client.get_world().get_actors().filter("vehicle.*"):
        vehicle.destroy()
    run_checks({"newborn": check_newborn, "free worlds": check_free_worlds, "stepped worlds": check_stepped_worlds}, client)
    passed("all")


run(main)
