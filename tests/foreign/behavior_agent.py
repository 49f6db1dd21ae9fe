"""A driver for CARLA's leaderboard and Bench2Drive: CARLA's own BehaviorAgent along the route, and on beyond its end.

    tests/foreign/leaderboard.py ... --agent tests/foreign/behavior_agent.py

It knows the world from the simulator, as BehaviorAgent does, and looks at no sensor; one small camera is there because the evaluator
counts frames. BEHAVIOR in the environment chooses among cautious, normal and aggressive.
"""

import os

from agents.navigation.behavior_agent import BehaviorAgent
from agents.navigation.local_planner import RoadOption
from leaderboard.autoagents.autonomous_agent import AutonomousAgent, Track
from srunner.scenariomanager.carla_data_provider import CarlaDataProvider
import carla

# An agent whose plan ends at the goal brakes before it, and never arrives.
BEYOND_M, STEP_M, LOOK_AHEAD = 40.0, 2.0, 12


def get_entry_point():
    return "BehaviorDriver"


class BehaviorDriver(AutonomousAgent):
    def setup(self, path_to_conf_file):
        self.track = Track.SENSORS
        self.agent = None

    def sensors(self):
        return [{"type": "sensor.camera.rgb", "x": 0.7, "y": 0.0, "z": 1.6, "roll": 0.0, "pitch": 0.0, "yaw": 0.0, "width": 64, "height": 48, "fov": 100, "id": "Center"}]

    def plan(self):
        world_map = CarlaDataProvider.get_map()
        ways = [world_map.get_waypoint(transform.location) for transform, _ in self._global_plan_world_coord]
        found = [step for a, b in zip(ways, ways[1:]) for step in self.agent.trace_route(a, b)]
        at = ways[-1]
        for _ in range(int(BEYOND_M / STEP_M)):
            following = at.next(STEP_M)
            if not following:
                break
            at = following[0]
            found.append((at, RoadOption.LANEFOLLOW))
        return found

    def run_step(self, input_data, timestamp):
        if self.agent is None:
            hero = next((actor for actor in CarlaDataProvider.get_world().get_actors().filter("vehicle.*") if actor.attributes.get("role_name") == "hero"), None)
            if hero is None:
                return carla.VehicleControl()
            self.agent = BehaviorAgent(hero, behavior=os.environ.get("BEHAVIOR", "normal"))
            self.agent.set_global_plan(self.plan())
            return carla.VehicleControl()
        planner = self.agent.get_local_planner()
        # BehaviorAgent looks ahead for a waypoint that is not there at the end of a plan, and stops with an exception.
        control = self.agent.run_step() if planner.get_incoming_waypoint_and_direction(steps=LOOK_AHEAD)[0] else planner.run_step()
        control.manual_gear_shift = False
        return control
