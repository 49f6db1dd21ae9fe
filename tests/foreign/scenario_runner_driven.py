"""Runs CARLA's scenario_runner with a driver for its ego vehicles: what a person at `manual_control.py` does in its guide.

    scenario_runner_driven.py SCENARIO_RUNNER [ARGUMENTS OF scenario_runner.py ...]

Needs scenario_runner's requirements and CARLA's `agents` package on PYTHONPATH. Every ego vehicle of a scenario that brings no driver
of its own follows its lane with CARLA's BasicAgent: it obeys lights and speed limits, brakes for what is ahead, and turns at the first
junction as the scenario's name says. Nothing of scenario_runner is changed. CARLA's route planner divides by the length of each lane;
those of no length, as early public files of Town03 and Town05 have, are left out of the topology, where both ends are one place anyway.
"""

import os
import random
import runpy
import sys

import carla

TURNS = (("left", -1), ("right", 1))
PLAN_M, STEP_M = 300.0, 2.0


def side(name):
    """-1, 1 or 0: to which side a scenario of this name turns."""
    words = name.lower()
    return next((sign for word, sign in TURNS if word + "turn" in words or "turning" + word in words), 0)


def plan(start, turn):
    """Waypoints along the lane, the sharpest way to one side at the first junction and the straightest at all others."""
    from agents.navigation.local_planner import RoadOption

    names = {-1: RoadOption.LEFT, 0: RoadOption.LANEFOLLOW, 1: RoadOption.RIGHT}
    route, at, way_m, first = [], start, 0.0, True
    while way_m < PLAN_M:
        ways = at.next(STEP_M)
        if not ways:
            break
        option = RoadOption.LANEFOLLOW
        if len(ways) > 1:
            def bend(way):
                ends = way.next_until_lane_end(STEP_M) or [way]
                return (ends[-1].transform.rotation.yaw - at.transform.rotation.yaw + 540.0) % 360.0 - 180.0

            wanted = turn if first else 0
            at = max(ways, key=lambda way: bend(way) * wanted) if wanted else min(ways, key=lambda way: abs(bend(way)))
            option, first = names[wanted], False
        else:
            at = ways[0]
        route.append((at, option))
        way_m += STEP_M
    return route


class Driver:
    """Drives one ego vehicle."""

    def __init__(self, vehicle, name, world_map):
        from agents.navigation.basic_agent import BasicAgent

        self.vehicle, self.map = vehicle, world_map
        self.agent = BasicAgent(vehicle, target_speed=30, map_inst=world_map)
        self.agent.follow_speed_limits(True)
        # CARLA's is_within_distance overlooks what is at an angle of exactly 0, straight ahead on a straight road.
        self.agent.set_offset(0.05)
        self.go_on(side(name))

    def go_on(self, turn):
        start = self.map.get_waypoint(self.vehicle.get_location())
        route = plan(start, turn) if start else []
        if route:
            self.agent.set_global_plan(route, stop_waypoint_creation=True, clean_queue=True)

    def step(self):
        if self.agent.done():
            self.go_on(0)
        control = self.agent.run_step()
        control.manual_gear_shift = False
        self.vehicle.apply_control(control)


def drive(manager_class):
    """Lets drivers act before each tick of a scenario."""
    from srunner.scenariomanager.carla_data_provider import CarlaDataProvider

    tick = manager_class._tick_scenario
    drivers = {}

    def driven(manager, timestamp):
        if manager._agent is None and manager._timestamp_last_run < timestamp.elapsed_seconds:
            for vehicle in manager.ego_vehicles or []:
                if vehicle is None or not vehicle.is_alive:
                    continue
                if vehicle.id not in drivers:
                    name = f"{manager.scenario.name} {manager.scenario_tree.name}"
                    drivers[vehicle.id] = Driver(vehicle, name, CarlaDataProvider.get_map())
                drivers[vehicle.id].step()
        tick(manager, timestamp)

    manager_class._tick_scenario = driven


def main():
    root = os.path.abspath(sys.argv[1])
    os.environ["SCENARIO_RUNNER_ROOT"] = root
    sys.path.insert(0, root)
    random.seed(0)
    topology = carla.Map.get_topology
    carla.Map.get_topology = lambda self: [(a, b) for a, b in topology(self) if a.transform.location.distance(b.transform.location) > 1e-5]
    from srunner.scenariomanager.scenario_manager import ScenarioManager

    drive(ScenarioManager)
    sys.argv = [os.path.join(root, "scenario_runner.py"), *sys.argv[2:]]
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
