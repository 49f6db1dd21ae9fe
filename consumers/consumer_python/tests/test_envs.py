"""gantry.envs: gymnasium's contract, worlds in a vector equal to worlds alone, refusals, and evaluation."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
import unittest
import warnings

import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import gantry
import gantry.envs
from gantry.envs import ars
from gantry.envs import INFO_NAMES, STATE_NAMES, DriveEnv, DriveVectorEnv, evaluate, task_text

SOURCE = pathlib.Path(__file__).resolve().parent.parent / "python"
IDS = ["gantry/LaneKeeping-v0", "gantry/EmergencyBrake-v0"]


def actions(n, step):
    """Actions by lot: some worlds drive straight ahead, some brake and some leave their lane."""
    lots = np.random.default_rng([9, step])
    steer, pedal = lots.uniform(-0.1, 0.1, n), lots.uniform(-1.0, 0.6, n)
    kind = np.arange(n) % 3
    return np.stack([np.where(kind == 1, 0.8, steer), np.where(kind == 2, -1.0, pedal)], axis=1).astype(np.float32)


class Case(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def task(self, name="LaneKeeping", **changes):
        """The path of a changed copy of a built-in task; a change is a key's new value."""
        lines = task_text(name).splitlines()
        for key, value in changes.items():
            found = [i for i, line in enumerate(lines) if line.startswith(f"{key} = ")]
            self.assertEqual(len(found), 1, key)
            lines[found[0]] = f"{key} = {value}"
        path = pathlib.Path(self.folder.name, f"{name}_{len(os.listdir(self.folder.name))}.toml")
        path.write_text("\n".join(lines))
        return path

    def vector(self, task, n, **more):
        envs = DriveVectorEnv(task, n, **more)
        self.addCleanup(envs.close)
        return envs

    def refused(self, kind, act, *words):
        with self.assertRaises(kind) as caught:
            act()
        for word in words:
            self.assertIn(word, str(caught.exception))

    def same(self, one, other, where=""):
        """Equal to the byte, with types and shapes."""
        self.assertEqual(type(one), type(other), where)
        if isinstance(one, dict):
            self.assertEqual(sorted(one), sorted(other), where)
            for key in one:
                self.same(one[key], other[key], f"{where}/{key}")
        elif isinstance(one, tuple):
            self.assertEqual(len(one), len(other), where)
            for i, (a, b) in enumerate(zip(one, other)):
                self.same(a, b, f"{where}[{i}]")
        elif isinstance(one, np.ndarray):
            self.assertEqual((one.shape, one.dtype), (other.shape, other.dtype), where)
            if one.dtype == object:
                for i, (a, b) in enumerate(zip(one, other)):
                    self.same(a, b, f"{where}[{i}]")
            else:
                self.assertEqual(one.tobytes(), other.tobytes(), where)
        else:
            self.assertEqual(one, other, where)


class Contract(Case):
    def test_gymnasiums_own_checker_accepts_every_environment(self):
        for name in IDS:
            env = gym.make(name)
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                check_env(env.unwrapped)
            others = [str(one.message) for one in said if "infinity" not in str(one.message)]
            self.assertEqual(others, [], name)
            env.close()

    def test_make_vec_gives_our_vector_with_gymnasiums_attributes(self):
        for name in IDS:
            envs = gym.make_vec(name, num_envs=5)
            self.addCleanup(envs.close)
            self.assertIsInstance(envs, DriveVectorEnv)
            self.assertEqual((envs.spec.id, envs.num_envs, envs.closed, envs.render_mode), (name, 5, False, None))
            self.assertIs(envs.metadata["autoreset_mode"], AutoresetMode.SAME_STEP)
            self.assertEqual(envs.single_observation_space.shape, (len(STATE_NAMES),))
            observations, infos = envs.reset(seed=3)
            self.assertIn(observations, envs.observation_space)
            self.assertEqual(sorted(infos), sorted([*INFO_NAMES, *(f"_{name}" for name in INFO_NAMES)]))
            observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
            self.assertIn(observations, envs.observation_space)
            self.assertEqual([one.dtype for one in (rewards, terminated, truncated)], [np.float32, np.bool_, np.bool_])
            envs.close()
            envs.close()
            self.assertTrue(envs.closed)

    def test_gymnasiums_vector_wrappers_count_episodes(self):
        task = self.task(limit_steps=5)
        envs = gym.wrappers.vector.RecordEpisodeStatistics(gym.make_vec("gantry/Task-v0", num_envs=3, task=str(task)))
        envs.reset(seed=1)
        totals = np.zeros(3)
        for step in range(5):
            _, rewards, _, truncated, infos = envs.step(np.tile(np.float32([0, 0.1]), (3, 1)))
            totals += rewards
        self.assertTrue(truncated.all())
        np.testing.assert_allclose(infos["episode"]["r"], totals, rtol=1e-6)
        self.assertEqual(infos["episode"]["l"].tolist(), [5, 5, 5])
        envs.close()

    def test_vectors_are_to_the_byte_what_gymnasium_makes_of_single_environments(self):
        """In each mode of autoreset, with lists of seeds, resets without seeds and masks."""
        for task in (self.task(limit_steps=6), self.task("EmergencyBrake", limit_steps=20)):
            for mode in AutoresetMode:
                n = 6
                ours = self.vector(task, n, autoreset_mode=mode, threads=2)
                theirs = SyncVectorEnv([lambda: DriveEnv(task)] * n, autoreset_mode=mode)
                self.addCleanup(theirs.close)
                self.same(ours.reset(seed=40), theirs.reset(seed=40), mode)
                n_ended = 0
                for step in range(60):
                    where = f"{task.name}, {mode}, step {step}"
                    chosen = actions(n, step)
                    a, b = ours.step(chosen), theirs.step(chosen)
                    self.same(a[0], b[0], where)
                    self.same(a[1].astype(np.float64), b[1], where)
                    self.same(a[2:], b[2:], where)
                    ended = a[2] | a[3]
                    n_ended += ended.sum()
                    if mode == AutoresetMode.DISABLED and ended.any():
                        self.same(ours.reset(options={"reset_mask": ended}), theirs.reset(options={"reset_mask": ended.copy()}), where)
                    elif step == 31:
                        mask, seeds = np.arange(n) % 2 == 1, [step, None, 7, 8, None, 9]
                        self.same(ours.reset(seed=seeds, options={"reset_mask": mask}), theirs.reset(seed=seeds, options={"reset_mask": mask.copy()}), where)
                    elif step == 45:
                        self.same(ours.reset(), theirs.reset(), where)
                self.assertGreater(n_ended, 8, f"{task.name}, {mode}")

    def test_gymnasiums_processes_step_single_environments(self):
        """They are forked from this process, which has loaded the module."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = gym.make_vec(IDS[1], num_envs=2, vectorization_mode="async", vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP})
        self.addCleanup(theirs.close)
        ours = self.vector("EmergencyBrake", 2)
        self.same(ours.reset(seed=4), theirs.reset(seed=4))
        for step in range(30):
            chosen = actions(2, step)
            a, b = ours.step(chosen), theirs.step(chosen)
            self.same(a[0], b[0], f"step {step}")

    def test_without_gymnasium_a_sentence_says_what_to_install(self):
        code = "import sys; sys.modules['gymnasium'] = None; import gantry; print('gantry is there'); import gantry.envs"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(SOURCE)})
        self.assertEqual((done.returncode, done.stdout), (1, "gantry is there\n"))
        self.assertIn("gantry.envs needs gymnasium", done.stderr.splitlines()[-1])
        self.assertIn("pip install 'gantry-sim[envs]'", done.stderr.splitlines()[-1])


class Worlds(Case):
    def test_a_world_in_a_vector_is_to_the_byte_the_world_alone(self):
        for task in ("LaneKeeping", "EmergencyBrake"):
            many = self.vector(task, 65, threads=3)
            state, _ = many.reset(seed=50)
            watched = {k: DriveEnv(task) for k in (0, 31, 64)}
            for k, env in watched.items():
                self.same(env.reset(seed=50 + k)[0], state[k])
            for step in range(80):
                chosen = actions(65, step)
                state, rewards, terminated, truncated, infos = many.step(chosen)
                for k, env in watched.items():
                    observation, reward, ended, cut, info = env.step(chosen[k])
                    where = f"{task}, world {k}, step {step}"
                    self.assertEqual((reward, ended, cut), (rewards[k], terminated[k], truncated[k]), where)
                    if ended or cut:
                        self.same(infos["final_obs"][k], observation, where)
                        self.assertEqual({name: infos["final_info"][name][k] for name in INFO_NAMES}, info, where)
                        observation, _ = env.reset()
                    self.same(state[k], observation, where)
            for env in watched.values():
                env.close()

    def test_calls_return_arrays_of_their_own_unless_told_otherwise(self):
        envs, reused = self.vector("LaneKeeping", 4), self.vector("LaneKeeping", 4, copy=False)
        first, _ = envs.reset(seed=1)
        kept = first.copy()
        second = envs.step(np.zeros((4, 2), np.float32))[0]
        self.assertFalse(np.shares_memory(first, second))
        self.same(first, kept)
        first, _ = reused.reset(seed=1)
        self.same(first, kept)
        again = reused.step(np.zeros((4, 2), np.float32))[0]
        self.assertTrue(np.shares_memory(first, again))
        self.same(again, second)

    def test_other_threads_run_while_worlds_step(self):
        envs = self.vector("LaneKeeping", 256, threads=1)
        envs.reset(seed=1)
        count, stop = [0], threading.Event()

        def other():
            while not stop.is_set():
                count[0] += 1
                time.sleep(0)

        usual = sys.getswitchinterval()
        thread = threading.Thread(target=other)
        thread.start()
        try:
            # From now on a thread gets the lock only if another one lets go of it.
            sys.setswitchinterval(100)
            wanted, arrays = np.zeros((256, 2), np.float32), envs._held._arrays()
            for _ in range(100):
                before = count[0]
                envs._held.worlds.step(wanted, arrays)
                after = count[0]
                if after > before:
                    break
        finally:
            sys.setswitchinterval(usual)
            stop.set()
            thread.join()
        self.assertGreater(after, before)

    def test_a_forked_child_is_told_that_it_has_no_threads(self):
        code = textwrap.dedent("""
            import os, numpy as np, gantry
            from gantry.envs import DriveVectorEnv
            envs, alone = DriveVectorEnv("LaneKeeping", 8, threads=2), DriveVectorEnv("LaneKeeping", 2, threads=1)
            envs.reset(seed=1)
            alone.reset(seed=1)
            child = os.fork()
            if child == 0:
                alone.step(np.zeros((2, 2)))
                try:
                    envs.step(np.zeros((8, 2)))
                except gantry.GantryError as error:
                    envs.close()
                    print(error, flush=True)
                    os._exit(0)
                os._exit(1)
            print(os.waitpid(child, 0)[1])
            envs.step(np.zeros((8, 2)))
        """)
        done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(SOURCE)}, timeout=300)
        self.assertEqual((done.returncode, done.stdout.splitlines()[-1]), (0, "0"), done.stderr)
        self.assertIn("threads=1", done.stdout)

    def test_forks_go_on_as_their_source_does(self):
        envs = self.vector("LaneKeeping", 6, threads=2)
        envs.reset(seed=2)
        for step in range(5):
            envs.step(actions(6, step))
        state = envs.fork(3, [0, 5])
        for k in (0, 5):
            self.same(state[k], state[3])
        for step in range(5, 15):
            chosen = actions(6, step)
            chosen[[0, 5]] = chosen[3]
            state, rewards, *_ = envs.step(chosen)
            for k in (0, 5):
                self.same(state[k], state[3])
                self.assertEqual(rewards[k], rewards[3])
        self.refused(ValueError, lambda: envs.fork(6, [0]), "no world 6", "0 to 5")
        self.refused(ValueError, lambda: envs.fork(0, [-1]), "no world -1", "0 to 5")


class Refusals(Case):
    def test_actions_that_cannot_be_name_world_and_index_and_move_nothing(self):
        envs, untouched = self.vector("LaneKeeping", 4), self.vector("LaneKeeping", 4)
        envs.reset(seed=1)
        untouched.reset(seed=1)
        for value, word in ((np.nan, "NaN"), (-np.inf, "-inf"), (1e300, "inf")):
            wrong = np.zeros((4, 2))
            wrong[2, 1] = value
            self.refused(ValueError, lambda: envs.step(wrong), f"action 1 (accelerate) of world 2 is {word}", "finite")
        self.refused(ValueError, lambda: envs.step(np.zeros((4, 3))), "(4, 3)", "(4, 2)", "steer and accelerate")
        self.refused(ValueError, lambda: envs.step(np.zeros(8)), "(8,)", "(4, 2)")
        self.refused(ValueError, lambda: envs.step([[0, 0], [0, 0], [0], [0, 0]]), "action of world 2", "(1,)")
        self.refused(ValueError, lambda: envs.step([["left", 0]] * 4), "no numbers")
        self.refused(ValueError, lambda: envs.step(None), "(1,)", "(4, 2)")
        same = actions(4, 0)
        self.same(envs.step(same)[0], untouched.step(same)[0])
        single = DriveEnv("LaneKeeping")
        single.reset(seed=1)
        self.refused(ValueError, lambda: single.step(np.float32([np.nan, 0])), "action 0 (steer) of world 0 is NaN")
        self.refused(ValueError, lambda: single.step(np.float32([0])), "(1, 2)")

    def test_calls_at_the_wrong_time_are_sentences(self):
        single = DriveEnv(self.task(limit_steps=1))
        self.refused(gantry.GantryError, lambda: single.step(np.zeros(2)), "world 0 was never reset")
        single.reset(seed=1)
        self.assertTrue(single.step(np.zeros(2))[3])
        self.refused(gantry.GantryError, lambda: single.step(np.zeros(2)), "the episode of world 0 has ended; reset it")
        single.close()
        self.refused(gantry.GantryError, lambda: single.step(np.zeros(2)), "closed", "make new ones")
        envs = self.vector("LaneKeeping", 2)
        one = np.array([True, False])
        self.refused(ValueError, lambda: envs.reset(seed=1, options={"reset_mask": one}), "leaves out world 1", "reset all worlds first")

    def test_arguments_that_cannot_be_are_sentences(self):
        envs = self.vector("LaneKeeping", 3)
        for seed, *words in ((-1, "seed is -1", "0 to 18446744073709551615"), ([1, 2], "2 seeds for 3 worlds"), ([1, 2, 1.5], "seed of world 2 is 1.5"), (1 << 64, "whole number")):
            self.refused(ValueError, lambda: envs.reset(seed=seed), *words)
        for mask in ([True] * 3, np.zeros(3, np.bool_), np.ones(2, np.bool_), np.ones(3)):
            self.refused(ValueError, lambda: envs.reset(options={"reset_mask": mask}), "reset_mask", "(3,)")
        self.refused(ValueError, lambda: envs.reset(options={"mask": 1}), "'mask'", "'reset_mask'")
        self.refused(ValueError, lambda: DriveEnv("LaneKeeping").reset(options={"x": 1}), "'x'", "nothing")
        self.refused(ValueError, lambda: DriveVectorEnv("LaneKeeping", 0), "num_envs is 0", "1 to 65536")
        self.refused(ValueError, lambda: DriveVectorEnv("LaneKeeping", 2, threads=0), "threads is 0")
        self.refused(ValueError, lambda: DriveVectorEnv("LaneKeeping", 2, autoreset_mode="Later"), "'Later'", "'SameStep'")
        self.refused(ValueError, lambda: DriveEnv("LaneKeeping", render_mode="human"), "'human'", "no pictures")

    def test_tasks_that_cannot_be_are_sentences(self):
        self.refused(ValueError, lambda: DriveEnv("Parking"), "'Parking'", "LaneKeeping, EmergencyBrake")
        self.refused(ValueError, lambda: DriveEnv(self.folder.name), "neither a file nor one of")
        self.refused(ValueError, lambda: DriveEnv(self.task(tick_ms=0)), "tick_ms is 0, allowed is 1 to 200")
        self.refused(ValueError, lambda: DriveEnv(self.task(limit_steps='"many"')), "limit_steps")
        self.refused(ValueError, lambda: DriveEnv(self.task(town='"Atlantis"')), "Atlantis")
        self.refused(ValueError, lambda: DriveEnv(self.task(vehicle='"vehicle.no.such"')), "vehicle.no.such")
        big, binary = pathlib.Path(self.folder.name, "big.toml"), pathlib.Path(self.folder.name, "binary.toml")
        big.write_bytes(b"#" * (1 << 20) + b"\n")
        binary.write_bytes(b"\xff\xfe")
        self.refused(ValueError, lambda: DriveEnv(big), "1048577 bytes", "1048576")
        self.refused(ValueError, lambda: DriveEnv(binary), "no text")


class TasksOfUsers(Case):
    def test_a_changed_copy_of_a_task_is_a_task(self):
        task = self.task(limit_steps=3, tick_ms=100)
        env = gym.make("gantry/Task-v0", task=str(task))
        start, _ = env.reset(seed=5)
        for step in range(3):
            state, _, terminated, truncated, info = env.step(np.float32([0, 0]))
            self.assertEqual((terminated, truncated), (False, step == 2))
        # Three steps of 0.1 s at about the speed of the start.
        self.assertAlmostEqual(info["progress_m"], 0.3 * 30 * float(start[3]), delta=0.5)
        env.close()

    def test_a_reward_of_ones_own_sees_the_step_itself_in_every_mode(self):
        task = self.task(limit_steps=4)
        seen = []

        def reward(step):
            seen.append(step)
            return step.info["progress_m"] - 10 * step.info["off_lane"] + step.state[:, 3]

        for mode in AutoresetMode:
            seen.clear()
            envs, single = self.vector(task, 3, reward=reward, autoreset_mode=mode), DriveEnv(task, reward=reward)
            envs.reset(seed=6)
            single.reset(seed=8)
            for step in range(4):
                chosen = actions(3, step)
                _, rewards, _, truncated, infos = envs.step(chosen)
                _, alone, *_ = single.step(chosen[2])
                self.assertEqual(rewards[2], np.float32(alone), f"{mode}, step {step}")
            self.assertTrue(truncated.all())
            self.assertGreater(rewards.min(), 1.0)
            if mode == AutoresetMode.NEXT_STEP:
                self.assertEqual(envs.step(actions(3, 4))[1].tolist(), [0, 0, 0])
        self.assertEqual(sorted(seen[0].info), sorted(INFO_NAMES))

    def test_a_reward_that_cannot_be_is_a_sentence(self):
        for made, *words in ((1.0, "()", "(2,)"), ([0, np.nan], "nan", "world 1")):
            envs = self.vector("LaneKeeping", 2, reward=lambda step: made)
            envs.reset(seed=1)
            self.refused(ValueError, lambda: envs.step(np.zeros((2, 2))), "reward=", *words)


class Evaluations(Case):
    def test_episodes_are_those_of_single_environments(self):
        """There are more seeds than worlds of a batch; the first and last of each are compared."""
        task, seeds = self.task("EmergencyBrake", limit_steps=120), range(300, 600)
        policy = lambda state: np.stack([0 * state[:, 0], 0.4 - 3 * state[:, 13] * (state[:, 14] < 0.3)], axis=1)  # noqa: E731
        found = evaluate(policy, task, seeds)
        for k in (0, 1, 255, 256, 298, 299):
            env = DriveEnv(task)
            state, _ = env.reset(seed=seeds[k])
            total, steps, ended = 0.0, 0, False
            while not ended:
                state, reward, terminated, truncated, info = env.step(policy(state[None])[0])
                total, steps, ended = total + reward, steps + 1, terminated or truncated
            self.assertEqual((found.scores[k], found.steps[k]), (total / 120, steps), f"seed {seeds[k]}")
            self.assertEqual([found.contact[k], found.safe_stop[k]], [info["contact"], info["safe_stop"]])
        self.assertGreater(found.safe_stop.sum(), 0)
        again = evaluate(policy, task, seeds, threads=1)
        self.same(found.scores, again.scores)
        self.assertEqual(found.score, again.score)

    def test_intervals_are_those_of_scipy(self):
        from scipy import stats

        from gantry.envs._evaluate import _bootstrap, _wilson

        for n, k in ((20, 0), (20, 20), (20, 3), (200, 1), (1, 0)):
            theirs = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
            ours = _wilson(np.arange(n) < k)
            np.testing.assert_allclose((ours.value, ours.low, ours.high), (k / n, theirs.low, theirs.high), atol=1e-12)
        scores = np.random.default_rng(4).gamma(2.0, size=60)
        ours = _bootstrap(scores)
        theirs = stats.bootstrap((scores,), np.mean, n_resamples=10_000, method="percentile", rng=np.random.default_rng(7)).confidence_interval
        # Both are drawn by lot: a hundredth of the width of the interval is what 10 000 resamples leave.
        np.testing.assert_allclose((ours.low, ours.high), (theirs.low, theirs.high), atol=0.05 * (theirs.high - theirs.low))

    def test_a_task_is_judged_by_its_own_rule(self):
        brake = lambda state: np.tile(np.float32([0, -1]), (len(state), 1))  # noqa: E731
        lenient = {"episodes": 10, "max_contact_share": 1.0, "max_needless_share": 1.0}
        asked = self.task("EmergencyBrake", **lenient)
        self.assertIs(evaluate(brake, asked, range(10)).solved, True)
        few = evaluate(brake, asked, range(9))
        self.assertIsNone(few.solved)
        self.assertIn("asks for 10 episodes", few.verdict)
        strict = evaluate(brake, self.task("EmergencyBrake", **{**lenient, "max_needless_share": 0.1}), range(10))
        self.assertIs(strict.solved, False)
        # Whoever brakes at once stops with nothing near ahead.
        self.assertGreater(strict.needless.value, 0.5)
        self.assertEqual(strict.needless.value, strict.needless_stop.mean())
        self.assertIn("not solved", strict.verdict)
        self.refused(ValueError, lambda: evaluate(brake, asked, []), "seeds is empty")
        self.refused(ValueError, lambda: evaluate(brake, asked, [1, -2]), "seeds[1] is -2")
        self.refused(ValueError, lambda: evaluate(lambda state: state, asked, [1]), "(1, 18)", "(1, 2)")


class Learning(Case):
    def test_a_policy_learns_far_beyond_chance(self):
        settings = ars.Settings(iterations=10, directions=8, best=4, episodes=2)
        policy, curve = ars.train("LaneKeeping", settings, seed=1)
        self.assertEqual([point.iteration for point in curve], list(range(10)))
        learned = evaluate(policy, "LaneKeeping", range(40))
        lots = np.random.default_rng(1)
        chance = evaluate(lambda state: lots.uniform(-1, 1, (len(state), 2)), "LaneKeeping", range(40))
        self.assertGreater(learned.score.low, chance.score.high + 0.1, f"{learned.verdict} {chance.verdict}")

    def test_the_same_seed_is_the_same_policy_with_any_number_of_threads(self):
        settings = ars.Settings(iterations=2, directions=4, best=2, episodes=2)
        task = self.task(limit_steps=40)
        one, other = (ars.train(task, settings, seed=5, threads=threads) for threads in (1, 2))
        self.same(one[0].weights, other[0].weights)
        self.assertEqual([point.mean_score for point in one[1]], [point.mean_score for point in other[1]])
        self.assertNotEqual(ars.train(task, settings, seed=6)[0].weights.tobytes(), one[0].weights.tobytes())

    def test_a_mirrored_car_steers_the_other_way_and_drives_as_fast(self):
        policy, _ = ars.train(self.task(limit_steps=40), ars.Settings(iterations=1, directions=2, best=2, episodes=1))
        state = np.random.default_rng(3).normal(size=(5, len(STATE_NAMES))).astype(np.float32)
        mirrored = state.copy()
        for i, name in enumerate(STATE_NAMES):
            if "left" in name or "offset" in name or name in ("sin heading", "yaw rate / 1 rad/s", "last steer"):
                mirrored[:, i] *= -1
        np.testing.assert_allclose(policy(mirrored), policy(state) * [-1, 1], atol=1e-12)
        self.assertGreater(np.abs(policy(state)).min(), 0)

    def test_the_program_writes_what_it_found_and_refuses_in_sentences(self):
        task, curve, saved = str(self.task(limit_steps=20)), pathlib.Path(self.folder.name, "curve.json"), pathlib.Path(self.folder.name, "policy.npz")

        def program(*words):
            env = {**os.environ, "PYTHONPATH": str(SOURCE)}
            return subprocess.run([sys.executable, "-m", "gantry.envs.ars", *words], capture_output=True, text=True, env=env, timeout=300)

        done = program(task, "--iterations", "2", "--json", str(curve), "--save", str(saved))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("LaneKeeping, 200 episodes:", done.stdout)
        record = json.loads(curve.read_text())
        self.assertEqual([point["iteration"] for point in record["curve"]], [0, 1])
        loaded = ars.Policy.load(saved)
        again = evaluate(loaded, task, range(200))
        self.assertEqual(record["evaluation"]["score"], again.score._asdict())
        for words, expected in ((["Parking"], "'Parking' is neither a file nor one of"), (["--iterations", "0"], "--iterations is 0"), (["--seed", "-1"], "--seed -1")):
            done = program(*words)
            self.assertEqual((done.returncode, done.stdout), (2, ""), done.stderr)
            self.assertTrue(done.stderr.startswith("error: ") and expected in done.stderr, done.stderr)
        np.savez(saved, weights=np.zeros(3), n=0, mean=np.zeros(2), spread=np.zeros(2))
        self.refused(ValueError, lambda: ars.Policy.load(saved), "weights has the shape (3,)", "is needed")


if __name__ == "__main__":
    unittest.main()
