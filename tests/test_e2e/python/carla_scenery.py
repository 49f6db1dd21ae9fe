"""What stands in the map, through the stock client: lists, boxes, layers, street lights, and what sensors see of changes.

Usage: carla_scenery.py PORT. Prints "<theme> passed" after each theme.
"""

import math
import sys

import carla
from carla_kit import connect, listen, of_tick, run, run_checks, step_by_hand, ticks

client = connect(sys.argv[1])
world = client.get_world()
before = step_by_hand(world)
library = world.get_blueprint_library()
LABEL = carla.CityObjectLabel


def watch(kind, transform, **attributes):
    blueprint = library.find(kind)
    for name, value in attributes.items():
        blueprint.set_attribute(name, str(value))
    return listen(world, blueprint, transform)


def check_objects():
    """Ids, names and boxes; a building's box stands on the ground and holds its place."""
    every = world.get_environment_objects(LABEL.Any)
    buildings = world.get_environment_objects(LABEL.Buildings)
    assert len(every) > 500 and len({o.id for o in every}) == len(every) and len({o.name for o in every}) == len(every)
    assert 20 < len(buildings) < len(every) and all(o.type == LABEL.Buildings for o in buildings)
    for building in buildings:
        box = building.bounding_box
        assert 2.0 < box.extent.z < 40.0 and 2.0 < box.extent.x < 60.0, box
        assert abs(box.location.z - box.extent.z) < 1.5, box
    assert {o.id for o in buildings} == {o.id for o in world.get_environment_objects(LABEL.Buildings)}
    assert len(world.get_level_bbs(LABEL.Buildings)) == len(buildings)
    assert {o.name for o in every} == set(world.get_names_of_all_objects())
    signs = world.get_environment_objects(LABEL.TrafficSigns)
    assert signs and all(o.bounding_box.extent.z < 3.0 for o in signs)


def middle(image):
    at = 4 * (32 * 64 + 32)
    return bytes(image.raw_data)[at : at + 4]


def metres(pixel):
    return 1000.0 * (pixel[2] + pixel[1] * 256 + pixel[0] * 65536) / (256**3 - 1)


class OverTheHouse:
    """Two cameras and a lidar over the highest house."""

    def __init__(self):
        self.n_buildings = len(buildings := world.get_environment_objects(LABEL.Buildings))
        self.house = max(buildings, key=lambda o: o.bounding_box.extent.z)
        place = self.house.bounding_box.location
        above = carla.Transform(carla.Location(place.x, place.y, 60.0), carla.Rotation(pitch=-90))
        size = dict(image_size_x=64, image_size_y=64, fov=20)
        self.camera, self.pictures = watch("sensor.camera.semantic_segmentation", above, **size)
        self.depths, self.depth_pictures = watch("sensor.camera.depth", above, **size)
        over = carla.Transform(carla.Location(place.x, place.y, 40.0))
        rays = dict(channels=16, upper_fov=-60, lower_fov=-89, range=80, rotation_frequency=20, points_per_second=40000)
        self.lidar, self.clouds = watch("sensor.lidar.ray_cast_semantic", over, **rays)

    def look(self):
        """Class and depth in the middle, and how many points of houses are near it."""
        tick = world.tick()
        tag = middle(of_tick(self.pictures, tick))[2]
        depth = metres(middle(of_tick(self.depth_pictures, tick)))
        cloud = of_tick(self.clouds, tick)
        near = sum(1 for p in cloud if int(p.object_tag) == int(LABEL.Buildings) and math.hypot(p.point.x, p.point.y) < 2.0)
        return tag, depth, near

    def end(self):
        for sensor in (self.camera, self.depths, self.lidar):
            sensor.destroy()


def check_hiding():
    """A camera and a lidar over a house no longer see it."""
    over = OverTheHouse()
    tag, depth, near = over.look()
    assert tag == int(LABEL.Buildings) and near > 50, (tag, depth, near)
    world.enable_environment_objects({over.house.id}, False)
    tag, lower, none = over.look()
    assert tag != int(LABEL.Buildings) and lower > depth + 2.0 and none == 0, (tag, depth, lower, none)
    assert len(world.get_level_bbs(LABEL.Buildings)) == over.n_buildings - 1
    world.enable_environment_objects({over.house.id}, True)
    assert over.look() == (int(LABEL.Buildings), depth, near)
    over.end()


def check_layers():
    """All houses go with their layer, and come back; trees stay."""
    over = OverTheHouse()
    before = over.look()
    world.unload_map_layer(carla.MapLayer.Buildings)
    tag, _, none = over.look()
    assert tag != int(LABEL.Buildings) and none == 0, (tag, none)
    assert not world.get_level_bbs(LABEL.Buildings) and world.get_level_bbs(LABEL.Vegetation)
    world.load_map_layer(carla.MapLayer.Buildings)
    assert over.look() == before
    over.end()


def check_lights():
    """Listed, off by day, switched by hand, seen by a camera at night."""
    manager = world.get_lightmanager()
    lights = manager.get_all_lights(carla.LightGroup.Street)
    assert len(lights) > 20 and not any(light.is_on for light in lights)
    weather = world.get_weather()
    weather.sun_altitude_angle = -40.0
    manager.set_day_night_cycle(False)
    world.set_weather(weather)
    world.tick()
    world.tick()
    assert not any(light.is_on for light in manager.get_all_lights(carla.LightGroup.Street)), "without the cycle night changes nothing"
    manager.set_day_night_cycle(True)
    # The client keeps its list until it is told that lamps changed; it asks again at the tick after.
    world.tick()
    world.tick()
    assert all(light.is_on for light in manager.get_all_lights(carla.LightGroup.Street))
    lamp = lights[0]
    seen = carla.Transform(lamp.location + carla.Location(x=-3.0, z=0.0), carla.Rotation())
    camera, pictures = watch("sensor.camera.rgb", seen, image_size_x=64, image_size_y=64, fov=40)

    def brightness():
        for _ in range(3):
            tick = world.tick()
        return sum(middle(of_tick(pictures, tick))[:3])

    shining = brightness()
    manager.turn_off([lamp])
    world.tick()
    dark = brightness()
    assert shining > dark + 100, (shining, dark)
    world.tick()
    lights = manager.get_all_lights(carla.LightGroup.Street)
    assert [light.is_on for light in lights].count(False) >= 1
    manager.set_color([lamp], carla.Color(10, 20, 30))
    manager.turn_on([lamp])
    world.tick()
    assert brightness() > dark + 100
    world.tick()
    again = next(light for light in manager.get_all_lights(carla.LightGroup.Street) if light.id == lamp.id)
    assert again.is_on and (again.color.r, again.color.g, again.color.b) == (10, 20, 30), again.color
    shades = {}
    for name, color in (("red", carla.Color(255, 0, 0)), ("blue", carla.Color(0, 0, 255))):
        manager.set_color([lamp], color)
        brightness()
        shades[name] = middle(of_tick(pictures, world.tick()))
    assert shades["red"][2] > shades["red"][0] + 50 and shades["blue"][0] > shades["blue"][2] + 50, [list(one) for one in shades.values()]
    shining = brightness()
    manager.set_intensity([lamp], 1e-4 * lamp.intensity)
    weak = brightness()
    assert weak < shining - 50, (weak, shining)
    camera.destroy()


def check_collisions():
    """Where a parked car or a tree stands, nothing can be spawned until it is hidden, and who gets there feels it."""
    car = library.find("vehicle.tesla.model3")
    thing = next(o for o in world.get_environment_objects(LABEL.Vegetation) if o.name.startswith("tree"))
    spot = carla.Transform(thing.transform.location + carla.Location(z=0.6))
    assert world.try_spawn_actor(car, spot) is None
    world.enable_environment_objects({thing.id}, False)
    world.tick()
    guest = world.try_spawn_actor(car, spot)
    assert guest is not None
    sensor, blows = listen(world, library.find("sensor.other.collision"), carla.Transform(), attach_to=guest)
    guest.set_transform(carla.Transform(spot.location + carla.Location(z=30.0)))
    world.tick()
    world.enable_environment_objects({thing.id}, True)
    guest.set_transform(spot)
    blow = of_tick(blows, world.tick())
    assert blow.actor.id == guest.id and blow.other_actor.type_id == "static.vegetation", blow.other_actor
    # Upside down onto the street.
    # The launch file puts its own car on the first place.
    street = world.get_map().get_spawn_points()[5]
    fall = carla.Transform(street.location + carla.Location(z=3.0), carla.Rotation(roll=180.0, yaw=street.rotation.yaw))
    guest.set_transform(fall)
    guest.set_target_velocity(carla.Vector3D())
    lifted = world.tick()
    ticks(world, 30)
    blow = of_tick(blows, lifted + 1)
    assert blow.other_actor.type_id == "static.road" and blow.normal_impulse.z > 0.0, (blow.other_actor.type_id, blow.normal_impulse.z)
    sensor.destroy()
    guest.destroy()
    world.tick()
    assert world.try_spawn_actor(car, spot) is None


def check_lamps_of_before():
    """A client's list of lamps outlives the map it was made for; those that this map does not have keep no others dark."""
    global world
    world = client.load_world("Town10HD")
    step_by_hand(world)
    gone = max(world.get_lightmanager().get_all_lights(), key=lambda lamp: lamp.id)
    world = client.load_world("Town02")
    step_by_hand(world)

    others = []

    def lamps():
        """As a client sees them that has known no other map. Clients are kept: the wheel may crash while it takes one apart between ticks."""
        others.append(connect(sys.argv[1]))
        return [(lamp.id, lamp.is_on) for lamp in others[-1].get_world().get_lightmanager().get_all_lights()]

    here = lamps()
    assert gone.id >= len(here) and not any(is_on for _, is_on in here), (gone.id, len(here))
    first = next(lamp for lamp in world.get_lightmanager().get_all_lights() if lamp.id == 0)
    world.get_lightmanager().turn_on([gone, first])
    world.tick()
    world.tick()
    assert [number for number, is_on in lamps() if is_on] == [0]
    world.get_lightmanager().turn_off([first])
    world.tick()


def main():
    run_checks({
        "objects": check_objects,
        "hiding": check_hiding,
        "layers": check_layers,
        "lights": check_lights,
        "collisions": check_collisions,
        "lamps_of_before": check_lamps_of_before,
    })
    world.apply_settings(before)


run(main)
