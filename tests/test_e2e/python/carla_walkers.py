"""People on foot through the stock `carla` 0.9.16 wheel: blueprints, control, collisions, navigation and the client's own crowd.

    carla_walkers.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import faulthandler
import math
import sys

import carla

STEP_SECS = 0.05


def near(a, b, tolerance=1e-3):
    return abs(a - b) <= tolerance


def check_blueprints(world):
    library = world.get_blueprint_library()
    walkers = library.filter("walker.pedestrian.*")
    assert [w.id for w in sorted(walkers, key=lambda w: w.id)] == [f"walker.pedestrian.{n:04}" for n in range(1, 53)]
    for walker in walkers:
        assert walker.get_attribute("age").as_str() in ("child", "teenager", "adult", "elderly")
        assert walker.get_attribute("gender").as_str() in ("female", "male", "other")
        assert walker.get_attribute("generation").as_int() in (1, 2)
        speeds = [float(v) for v in walker.get_attribute("speed").recommended_values]
        assert speeds[0] == 0.0 and 0.8 < speeds[1] < 1.8 and speeds[1] < speeds[2] < 4.0, speeds
        assert walker.get_attribute("is_invincible").as_bool()
        walker.set_attribute("is_invincible", "false")
        if walker.has_attribute("can_use_wheelchair"):
            walker.set_attribute("use_wheelchair", "True")
        else:
            assert not walker.has_attribute("use_wheelchair")
        assert walker.has_tag("walker") and walker.has_tag("pedestrian")
    assert any(w.has_attribute("can_use_wheelchair") for w in walkers)
    assert library.find("controller.ai.walker").id == "controller.ai.walker"
    car = library.find("vehicle.tesla.model3")
    assert len(car.get_attribute("color").recommended_values) > 3


def pavement(world, n=0):
    """A place on a pavement: beside a spawn point, on the outermost lane to the right."""
    town = world.get_map()
    waypoint = town.get_waypoint(town.get_spawn_points()[n].location, lane_type=carla.LaneType.Sidewalk)
    assert waypoint.lane_type == carla.LaneType.Sidewalk
    return waypoint.transform


def check_control(world):
    library = world.get_blueprint_library()
    at = pavement(world)
    at.location.z += 1.5
    walker = world.spawn_actor(library.find("walker.pedestrian.0001"), at)
    for _ in range(30):
        world.tick()
    assert walker.type_id == "walker.pedestrian.0001" and walker.attributes["age"] == "adult"
    assert walker.semantic_tags == [12], walker.semantic_tags
    half = walker.bounding_box.extent
    assert 0.7 < half.z < 1.0 and 0.1 < half.x < 0.35 and 0.1 < half.y < 0.35, half
    stands = walker.get_location()
    ground = world.get_map().get_waypoint(stands, lane_type=carla.LaneType.Sidewalk).transform.location
    # The origin is the middle of the body; the kerb is up to 0.2 m over the road.
    assert -0.02 < stands.z - half.z - ground.z < 0.21, (stands, ground, half)
    forward = at.get_forward_vector()
    walker.apply_control(carla.WalkerControl(direction=forward, speed=1.3))
    for _ in range(20):
        world.tick()
    control = walker.get_control()
    assert near(control.speed, 1.3) and near(control.direction.x, forward.x) and near(control.direction.y, forward.y)
    assert near(walker.get_velocity().length(), 1.3, 0.02), walker.get_velocity()
    assert stands.distance_2d(walker.get_location()) > 1.2
    yaw = walker.get_transform().rotation.yaw
    assert abs((yaw - math.degrees(math.atan2(forward.y, forward.x)) + 180.0) % 360.0 - 180.0) < 0.1
    # A batch does the same.
    ground_z = walker.get_location().z
    stop = carla.command.ApplyWalkerControl(walker, carla.WalkerControl(speed=0.0, jump=True))
    assert not walker_errors(world_client.apply_batch_sync([stop], True))
    heights = []
    for _ in range(16):
        world.tick()
        heights.append(walker.get_location().z)
    assert 1.1 < max(heights) - ground_z < 1.3, "a jump at 5 m/s goes 1.27 m high"
    refused = world.try_spawn_actor(library.find("walker.pedestrian.0002"), carla.Transform(walker.get_location()))
    assert refused is None, "a place that is taken"
    assert walker.destroy()


def walker_errors(responses):
    return [response.error for response in responses if response.has_error()]


def check_collision(world):
    library = world.get_blueprint_library()
    point = world.get_map().get_spawn_points()[3]
    car = world.try_spawn_actor(library.find("vehicle.tesla.model3"), point)
    person = library.find("walker.pedestrian.0020")
    person.set_attribute("is_invincible", "false")
    forward = point.get_forward_vector()
    ahead = carla.Location(point.location.x + 7.0 * forward.x, point.location.y + 7.0 * forward.y, point.location.z + 1.0)
    walker = world.spawn_actor(person, carla.Transform(ahead, point.rotation))
    for _ in range(20):
        world.tick()
    car.set_target_velocity(carla.Vector3D(9.0 * forward.x, 9.0 * forward.y, 0.0))
    before = walker.get_location()
    for _ in range(60):
        world.tick()
    after = walker.get_transform()
    assert before.distance(after.location) > 2.0, "the car pushes"
    assert after.get_up_vector().z < 0.3, "it lies"
    assert all(math.isfinite(x) for x in (after.location.x, after.location.y, after.location.z))
    assert walker.destroy() and car.destroy()


def main():
    global world_client
    world_client = client = carla.Client("127.0.0.1", int(sys.argv[1]))
    client.set_timeout(60.0)
    world = client.get_world()
    settings = world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, STEP_SECS
    world.apply_settings(settings)
    world.tick()
    for check in (check_blueprints, check_control, check_collision):
        check(world)
        print(check.__name__.removeprefix("check_"), "passed", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(240, exit=True)
    main()
