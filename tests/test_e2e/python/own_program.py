"""A user's program in Python beside a running simulator: lockstep, controls, results; `python own_program.py DOMAIN [hold]`.

Run by `tests/it/python.rs` in a sandbox. Ends with 1 and a traceback if a promise is broken. With `hold` it joins lockstep, says so and
holds the world until it is killed.
"""

import asyncio
import sys
import threading
import time

import gantry
import numpy as np

DOMAIN = sys.argv[1]
PATIENCE_SECS = 60.0
TICKS = 12


def newest_tick():
    return gantry.snapshot(timeout=PATIENCE_SECS).tick


def eventually(what, condition):
    """Waits for a condition."""
    deadline = time.monotonic() + PATIENCE_SECS
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not come true"
        time.sleep(0.01)


def assert_free():
    """The world goes on without this program."""
    tick = newest_tick()
    eventually("the world going on", lambda: newest_tick() > tick + 2)


def check_lockstep():
    """Ticks come one by one, the world stands still in between, and leaving in any way frees it."""
    with gantry.lockstep("mine", timeout=PATIENCE_SECS) as lockstep, gantry.open("ego/imu/imu") as imu:
        ticks = []
        for tick in lockstep:
            assert isinstance(tick, int) and tick.snapshot.tick == tick and tick.sim_time == tick.snapshot.sim_time
            ticks.append(tick)
            if len(ticks) == 3:
                while (frame := imu.next(timeout=PATIENCE_SECS)).tick < tick:
                    pass
                assert frame.tick == tick, "the sensor's frame of this tick comes while the world waits"
                time.sleep(0.3)
                assert newest_tick() == tick, "the world waits"
                assert gantry.snapshot_at(tick).tick == tick
            if len(ticks) == TICKS:
                break
        assert ticks == list(range(ticks[0], ticks[0] + TICKS)) and ticks[0] == lockstep.first_tick, ticks
    assert_free()
    try:
        with gantry.lockstep("mine", timeout=PATIENCE_SECS) as lockstep:
            lockstep.next(timeout=PATIENCE_SECS)
            raise KeyError("of the program")
    except KeyError:
        pass
    assert_free()
    lockstep = gantry.lockstep("mine", timeout=PATIENCE_SECS)
    lockstep.next(timeout=PATIENCE_SECS)
    del lockstep
    assert_free()


def check_rows():
    """A row for each tick with what the topics sent of it; nothing of earlier ticks, and nobody's result is waited for too long."""
    camera, imu, answers = "ego/front/semantic", "ego/imu/imu", "rows/answers"
    with gantry.publish(answers, "scalars") as out, gantry.lockstep("rows", timeout=PATIENCE_SECS, topics=[camera, imu, answers], results_secs=0.1) as rows:
        car, seen = gantry.ego(timeout=PATIENCE_SECS), []
        for row in rows:
            assert row.tick == row.snapshot.tick and row[imu].tick == row.tick and row[imu].epoch == row.snapshot.epoch
            assert camera not in row or row[camera].tick == row.tick
            # The tick before was answered; this one by nobody yet.
            assert answers not in row, row
            out.send({"tick": row.tick}, answers=row[imu])
            pose = row.snapshot.pose(car)
            assert pose.translation_m == tuple(row.snapshot.actor(car.id)["world_from_actor"]["translation_m"].tolist())
            assert row.snapshot.speed_mps(car) >= 0.0
            seen.append(row.tick)
            assert newest_tick() == row.tick, "the world waits"
            if len(seen) == TICKS:
                break
        assert seen == list(range(seen[0], seen[0] + TICKS)), seen
    assert_free()

    def answer():
        with gantry.lockstep("answerer", timeout=PATIENCE_SECS, topics=[imu]) as turns, gantry.publish(answers, "scalars") as out:
            ready.set()
            for turn in turns:
                time.sleep(0.02)
                out.send({"tick": turn.tick}, answers=turn[imu])
                if done.is_set():
                    return

    ready, done = threading.Event(), threading.Event()
    thread = threading.Thread(target=answer)
    thread.start()
    assert ready.wait(PATIENCE_SECS)
    with gantry.lockstep("asker", timeout=PATIENCE_SECS, topics=[answers], results_secs=PATIENCE_SECS) as rows:
        for n, row in enumerate(rows):
            assert row.result(answers).scalars == {"tick": row.tick}, row
            if n == TICKS:
                done.set()
                break
    thread.join(PATIENCE_SECS)
    assert_free()


def check_actors():
    """Actors are found by role and type, and spawned where a pose says."""
    world = gantry.world(timeout=PATIENCE_SECS)
    (ego,) = world.find(role="ego_vehicle")
    assert ego.id == gantry.ego().id and ego.type_id.startswith("vehicle.") and ego in world.find(type="vehicle.*")
    assert world.find() == world.actors and world.find(role="nobody") == []
    front = next(actor for actor in world.find(type="sensor.*") if actor.topics.get("semantic") == "ego/front/semantic")
    assert front.parent_id == ego.id
    world_from_ego = world.snapshot.pose(ego)
    wanted = world_from_ego @ gantry.Pose((0.0, 0.0, 30.0))
    made = gantry.spawn("static.prop.trafficcone01", wanted, role="mine")
    eventually("the cone's snapshot", lambda: made.id in gantry.snapshot().actors["id"])
    eventually("the cone in the list", lambda: [one.id for one in gantry.world().find(role="mine", type="static.prop.*")] == [made.id])
    at = gantry.snapshot().pose(made).translation_m
    assert np.allclose(at[:2], wanted.translation_m[:2], atol=0.01), (at, wanted)
    try:
        gantry.spawn("vehicle.of.dreams", wanted)
    except gantry.GantryError as error:
        assert "vehicle.of.dreams" in str(error), error
    else:
        raise AssertionError("an unknown type was spawned")
    try:
        gantry.ego(timeout=0.1, role="pilot")
    except gantry.TimedOutError as error:
        assert "has the role 'pilot'; roles of its vehicles: " in str(error) and "ego_vehicle" in str(error), error
    else:
        raise AssertionError("a role that nobody has was found")
    gantry.command({"do": "destroy", "actor_id": made.id})


def check_two_participants():
    """Two threads in lockstep under two names see the same ticks; a name that is taken is refused."""
    seen = {"one": [], "two": []}
    joined = threading.Barrier(2)

    def take_part(name):
        with gantry.lockstep(name, timeout=PATIENCE_SECS) as lockstep:
            joined.wait(PATIENCE_SECS)
            for tick in lockstep:
                seen[name].append(int(tick))
                if len(seen[name]) == TICKS:
                    return

    threads = [threading.Thread(target=take_part, args=(name,)) for name in seen]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_SECS)
    assert all(len(ticks) == TICKS and ticks == list(range(ticks[0], ticks[0] + TICKS)) for ticks in seen.values()), seen
    assert_free()


def check_event_loop():
    """The same with `async for`, beside a topic of results."""

    async def main():
        with gantry.publish("mine/ticks", "scalars") as topic, gantry.open("mine/ticks", result="scalars") as results:

            async def step():
                with gantry.lockstep("loop", timeout=PATIENCE_SECS) as lockstep:
                    n = 0
                    async for tick in lockstep:
                        topic.send({"tick": float(tick)}, tick=tick)
                        n += 1
                        if n == TICKS:
                            return

            stepping = asyncio.create_task(step())
            ticks = []
            async for result in results:
                assert result.scalars == {"tick": result.tick}
                ticks.append(result.tick)
                del result
                if len(ticks) == TICKS:
                    break
            await stepping
            assert ticks == list(range(ticks[0], ticks[0] + TICKS)), ticks

    asyncio.run(main())
    assert_free()


def check_control():
    """Records reach the vehicle before the next tick, singly and many at once."""
    actors = gantry.document("world/actors", timeout=PATIENCE_SECS).json()["actors"]
    (ego,) = (actor["id"] for actor in actors if actor["role"] == "ego_vehicle")
    others = [actor["id"] for actor in actors if actor["type_id"].startswith("vehicle.") and actor["id"] != ego][:2]
    car = gantry.vehicle(ego)

    def part(tick, actor_id):
        return np.ascontiguousarray(tick.snapshot.actor(actor_id)["part"]).view(gantry.VEHICLE_PART)[0]

    with gantry.lockstep("driver", timeout=PATIENCE_SECS) as lockstep:
        lockstep.next(timeout=PATIENCE_SECS)
        car.control(throttle=0.75, steer=-0.5)
        found = part(lockstep.next(timeout=PATIENCE_SECS), ego)
        assert (found["throttle_ratio"], found["steer_ratio"], found["brake_ratio"]) == (0.75, -0.5, 0.0), found
        for tick in lockstep:
            speed = np.linalg.norm(tick.snapshot.actor(ego)["velocity_in_world_mps"])
            if speed > 1.0:
                break
        gantry.control({ego: {"brake": 1.0, "hand_brake": True}, **{other: {"gear": 1, "throttle": 0.25} for other in others}})
        tick = lockstep.next(timeout=PATIENCE_SECS)
        assert part(tick, ego)["brake_ratio"] == 1.0 and part(tick, ego)["throttle_ratio"] == 0.0
        assert all(part(tick, other)["throttle_ratio"] == 0.25 for other in others)
        records = np.zeros(1, gantry.VEHICLE_CONTROL)
        records["actor_id"], records["throttle_ratio"], records["lamps"] = ego, 0.5, 2**32 - 1
        gantry.control(records)
        assert part(lockstep.next(timeout=PATIENCE_SECS), ego)["throttle_ratio"] == 0.5


def check_chain():
    """A detector and a tracker in one process: results answer frames, and `sync` joins both."""
    with gantry.open("ego/front/semantic") as camera, gantry.publish("chain/boxes", "boxes2d") as boxes:
        with gantry.sync(["ego/front/semantic", "chain/boxes"], snapshots=True) as rows, gantry.publish("chain/tracks", "tracks") as tracks, gantry.open(
            "chain/tracks", result="tracks"
        ) as out:
            deadline, row = time.monotonic() + PATIENCE_SECS, None
            while row is None:
                assert time.monotonic() < deadline, "no box met its frame"
                frame = camera.latest(timeout=PATIENCE_SECS)
                boxes.send(gantry.boxes2d([[1, 2]], [[30, 40]], class_=14), answers=frame)
                frame = None
                # A reader that the machine leaves waiting loses the frame that was answered.
                row = rows.next(timeout=0.5, or_none=True)
            assert row is not None and row.snapshot.tick == row.tick == row["chain/boxes"].tick
            (answered,) = row["chain/boxes"].inputs
            assert (answered.topic, answered.tick, answered.seq) == ("ego/front/semantic", row.tick, row["ego/front/semantic"].seq)
            tracks.send(gantry.tracks([1], min_px=[[1, 2]], max_px=[[30, 40]]), answers=row)
            track = out.next(timeout=PATIENCE_SECS)
            assert track.tick == row.tick and track.header.origin_mono_nanos == row["ego/front/semantic"].published_mono_nanos
            assert {topic.name: topic.result for topic in gantry.topics() if topic.kind == "result"} == {"chain/boxes": "boxes2d", "chain/tracks": "tracks"}


def hold():
    with gantry.lockstep("holder", timeout=PATIENCE_SECS) as lockstep:
        tick = lockstep.next(timeout=PATIENCE_SECS)
        print(f"holding {tick}", flush=True)
        time.sleep(1e6)


if "hold" in sys.argv:
    hold()
for check in (check_lockstep, check_rows, check_actors, check_two_participants, check_event_loop, check_control, check_chain):
    check()
    print(f"{check.__name__} passed", flush=True)
