"""People on foot through the stock `carla` 0.9.16 wheel: blueprints, control, collisions, navigation and the client's own crowd.

    carla_walkers.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import math
import queue
import sys

import carla
import numpy as np
from carla_kit import STEP_SECS, listen, near, of_tick, run, run_checks, stage



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
    # No faster than 15 m/s, and round at 540 degrees a second.
    walker.apply_control(carla.WalkerControl(direction=forward * -1.0, speed=50.0))
    turns = []
    for _ in range(10):
        before = walker.get_transform().rotation.yaw
        world.tick()
        turns.append(abs((walker.get_transform().rotation.yaw - before + 180.0) % 360.0 - 180.0))
    assert near(max(turns), 540.0 * STEP_SECS, 0.5) and near(sum(turns), 180.0, 0.5), turns
    assert near(walker.get_velocity().length(), 15.0, 0.1), walker.get_velocity()
    walker.apply_control(carla.WalkerControl(direction=forward, speed=0.0))
    for _ in range(10):
        world.tick()
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


def check_props(world):
    library = world.get_blueprint_library()
    props = library.filter("static.prop.*")
    assert len(props) >= 95, len(props)
    assert all(p.get_attribute("size").as_str() in ("tiny", "small", "medium", "big", "huge", "unknown") for p in props)
    at = pavement(world, 20)
    cone = world.spawn_actor(library.find("static.prop.trafficcone01"), at)
    box = world.spawn_actor(library.find("static.prop.box01"), carla.Transform(carla.Location(at.location.x, at.location.y, at.location.z + 20.0)))
    world.tick()
    assert cone.type_id == "static.prop.trafficcone01" and cone.get_location().distance(at.location) < 1e-3
    assert 0.3 < cone.bounding_box.extent.z < 0.4 and abs(cone.bounding_box.location.z - cone.bounding_box.extent.z) < 1e-3
    assert {a.id for a in world.get_actors().filter("static.prop.*")} == {cone.id, box.id}
    assert world.try_spawn_actor(library.find("vehicle.audi.tt"), at) is None, "a cone is in the way"
    assert cone.destroy() and box.destroy()


def on_ground(world, crosswalks, location):
    """What a point lies on by the wheel's own map: "crosswalk", "road", or "pavement" (any ground that is neither)."""
    if any(inside(outline, location) for outline in crosswalks):
        return "crosswalk"
    waypoint = world.get_map().get_waypoint(location, project_to_road=False, lane_type=carla.LaneType.Driving)
    return "pavement" if waypoint is None else "road"


def inside(outline, p):
    odd = False
    for a, b in zip(outline, outline[1:] + outline[:1]):
        if (a.y > p.y) != (b.y > p.y) and p.x < a.x + (p.y - a.y) * (b.x - a.x) / (b.y - a.y):
            odd = not odd
    return odd


def crosswalk_outlines(world):
    """The wheel lists corners one after the other; an outline ends where its first corner comes again."""
    outlines, current = [], []
    for corner in world.get_map().get_crosswalks():
        if current and corner.distance(current[0]) < 1e-3:
            outlines.append(current)
            current = []
        else:
            current.append(corner)
    return outlines


def check_navigation(world):
    town = world.get_map()
    crosswalks = crosswalk_outlines(world)
    assert len(crosswalks) > 10, len(crosswalks)
    world.set_pedestrians_seed(5)
    near_lane = 0
    for _ in range(300):
        location = world.get_random_location_from_navigation()
        assert location is not None, "the navigation mesh does not load"
        ground = on_ground(world, crosswalks, location)
        assert ground != "road", location
        waypoint = town.get_waypoint(location, lane_type=carla.LaneType.Sidewalk)
        away = waypoint.transform.location.distance_2d(location)
        near_lane += away <= 0.5 * waypoint.lane_width
        assert away < 12.0 and abs(waypoint.transform.location.z - location.z) < 0.6, (location, waypoint)
    assert near_lane > 240, f"{near_lane} of 300 places are on pavement lanes; the others are round corners and on crosswalks"


def check_crowd(world):
    client, library = world_client, world.get_blueprint_library()
    crosswalks = crosswalk_outlines(world)
    world.set_pedestrians_seed(11)
    world.set_pedestrians_cross_factor(0.0)
    kinds = sorted((b for b in library.filter("walker.pedestrian.*") if b.get_attribute("age").as_str() == "adult"), key=lambda b: b.id)
    walkers = []
    for n in range(60):
        if len(walkers) == 20:
            break
        place = carla.Transform(world.get_random_location_from_navigation())
        place.location.z += 1.0
        walker = world.try_spawn_actor(kinds[n % len(kinds)], place)
        if walker is not None:
            walkers.append(walker)
    assert len(walkers) == 20, len(walkers)
    make = [carla.command.SpawnActor(library.find("controller.ai.walker"), carla.Transform(), walker) for walker in walkers]
    answers = client.apply_batch_sync(make, True)
    assert not walker_errors(answers), walker_errors(answers)
    controllers = [world.get_actor(answer.actor_id) for answer in answers]
    world.tick()
    for controller in controllers:
        controller.start()
        controller.go_to_location(world.get_random_location_from_navigation())
        controller.set_max_speed(1.4)
    ways, speeds, seen = [0.0] * 20, [], {"pavement": 0, "crosswalk": 0, "road": 0}
    last = [walker.get_location() for walker in walkers]
    for tick in range(1200):
        world.tick()
        if tick % 10:
            continue
        for i, walker in enumerate(walkers):
            at = walker.get_location()
            ways[i] += at.distance_2d(last[i])
            last[i] = at
            seen[on_ground(world, crosswalks, at)] += 1
            # Feet on the ground: the middle of the body is half its height over pavement or road.
            ground = world.get_map().get_waypoint(at, lane_type=carla.LaneType.Any).transform.location.z
            assert -0.05 < at.z - walker.bounding_box.extent.z - ground < 0.4, (at, ground)
            speeds.append(walker.get_velocity().length())
    print(f"20 walkers, 60 s: {min(ways):.0f} to {max(ways):.0f} m each, seen {seen}")
    assert seen["road"] <= 0.01 * sum(seen.values()), seen
    # At 1.4 m/s; who runs into another is pushed aside at once by the client.
    assert sum(mps > 1.6 for mps in speeds) <= 0.02 * len(speeds), sorted(speeds)[-60:]
    assert sorted(ways)[5] > 25.0, "three of four walk most of the time"
    assert seen["crosswalk"] > 0, "somebody crosses"
    for controller in controllers:
        controller.stop()
        controller.destroy()
    for walker in walkers:
        walker.destroy()


def check_bones(world):
    library = world.get_blueprint_library()
    at = pavement(world)
    at.location.z += 1.0
    walker = world.spawn_actor(library.find("walker.pedestrian.0001"), at)
    # From the side, 3 m away: what the arm covers in front of the body.
    blueprint = library.find("sensor.camera.instance_segmentation")
    for name, value in (("image_size_x", "200"), ("image_size_y", "200"), ("fov", "50")):
        blueprint.set_attribute(name, value)
    beside = carla.Transform(carla.Location(y=3.0), carla.Rotation(yaw=-90.0))
    camera = world.spawn_actor(blueprint, beside, attach_to=walker)
    pictures = queue.Queue()
    camera.listen(pictures.put)

    def columns():
        tick = world.tick()
        while True:
            picture = pictures.get(timeout=60.0)
            if picture.frame == tick:
                pixels = np.frombuffer(picture.raw_data, np.uint8).reshape(200, 200, 4)
                return int((pixels[..., 2] == 12).any(axis=0).sum())

    def bones():
        return {bone.name: bone for bone in walker.get_bones().bone_transforms}

    for _ in range(20):
        world.tick()
    hanging, before = columns(), bones()
    assert len(before) == 66 and {"crl_root", "crl_hips__C", "crl_Head__C", "crl_hand__R", "crl_toeEnd__L"} <= set(before), sorted(before)
    root, head, hand = (before[name] for name in ("crl_root", "crl_Head__C", "crl_hand__R"))
    height = 2.0 * walker.bounding_box.extent.z
    assert near(root.world.location.z, walker.get_location().z - 0.5 * height, 1e-3) and 0.8 < head.component.location.z / height < 0.97
    # In CARLA's axes the right hand is at positive y.
    assert hand.component.location.y > 0.1 > 0 > before["crl_hand__L"].component.location.y
    length = before["crl_arm__R"].component.location.z - before["crl_foreArm__R"].component.location.z
    assert 0.2 < length < 0.4, length
    # The arm straight forward, first kept back, then shown by half, then wholly.
    walker.set_bones(carla.WalkerBoneControlIn([(f"crl_arm__{side}", carla.Transform(before[f"crl_arm__{side}"].relative.location, carla.Rotation(pitch=90.0))) for side in "LR"]))
    assert columns() == hanging
    walker.blend_pose(0.5)
    half = columns()
    elbow = bones()
    forward = elbow["crl_foreArm__R"].component.location.x - elbow["crl_arm__R"].component.location.x
    assert 0.55 * length < forward < 0.85 * length, (forward, length)
    walker.show_pose()
    whole = columns()
    after = bones()
    forward = after["crl_foreArm__R"].component.location.x - after["crl_arm__R"].component.location.x
    assert near(forward, length, 0.01), (forward, length)
    assert hanging + 5 < half < whole - 5, (hanging, half, whole)
    walker.hide_pose()
    assert columns() == hanging
    # The gait's own pose, held, stays while the walker walks on.
    walker.apply_control(carla.WalkerControl(direction=at.get_forward_vector(), speed=1.3))
    for _ in range(20):
        world.tick()
    walker.get_pose_from_animation()
    walker.show_pose()
    world.tick()
    held = bones()["crl_leg__L"].component.location
    for _ in range(7):
        world.tick()
        assert bones()["crl_leg__L"].component.location.distance(held) < 1e-4
    walker.hide_pose()
    world.tick()
    assert bones()["crl_leg__L"].component.location.distance(held) > 0.01
    camera.destroy()
    walker.destroy()


def check_wheelchair(world):
    """Who uses one sits lower and takes more room to the front and the back, and rolls as fast as told."""
    library, at = world.get_blueprint_library(), pavement(world)
    at.location.z += 1.0
    person = next(one for one in sorted(library.filter("walker.*"), key=lambda one: one.id) if one.has_attribute("can_use_wheelchair"))
    blueprint = library.find("sensor.camera.instance_segmentation")
    for name, value in (("image_size_x", "100"), ("image_size_y", "100"), ("fov", "50")):
        blueprint.set_attribute(name, value)
    seen = {}
    for uses in ("False", "True"):
        person.set_attribute("use_wheelchair", uses)
        walker = world.spawn_actor(person, at)
        camera, pictures = listen(world, blueprint, carla.Transform(carla.Location(y=3.0), carla.Rotation(yaw=-90.0)), attach_to=walker)
        for _ in range(20):
            tick = world.tick()
        pixels = np.frombuffer(of_tick(pictures, tick).raw_data, np.uint8).reshape(100, 100, 4)
        rows, columns = np.nonzero(pixels[..., 1] + 256 * pixels[..., 0].astype(int) == walker.id)
        assert len(rows) > 100, len(rows)
        seen[uses] = rows.max() - rows.min(), columns.max() - columns.min()
        walker.apply_control(carla.WalkerControl(direction=at.get_forward_vector(), speed=1.0))
        for _ in range(10):
            world.tick()
        assert near(walker.get_velocity().length(), 1.0, 0.02), walker.get_velocity()
        camera.destroy()
        walker.destroy()
        world.tick()
    assert seen["True"][0] < 0.9 * seen["False"][0] and seen["True"][1] > 1.3 * seen["False"][1], seen


def main():
    global world_client
    world_client, world = stage(sys.argv[1])
    checks = (check_blueprints, check_control, check_collision, check_bones, check_wheelchair, check_props, check_navigation, check_crowd)
    run_checks({check.__name__.removeprefix("check_"): check for check in checks}, world)


run(main)
