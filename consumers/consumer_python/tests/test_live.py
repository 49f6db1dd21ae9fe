"""Frames read live from another process: the Rust example `test_card`, in a private iceoryx2 root and prefix."""

import signal
import subprocess
import time
import unittest

from live_kit import TEST_CARD, CardCase


class Live(CardCase):
    """Reading, each test in a process of its own."""

    def test_every_frame_kind_is_read_in_place(self):
        self.script("""
            names = [topic.name for topic in gantry.topics("live") if topic.modality]
            assert len(names) == 16, names
            for name in names:
                with gantry.open(name, domain="live") as topic:
                    frame = topic.next(timeout=10)
                    assert frame is not None, name
                    assert frame.topic == name and frame.header.seq == frame.tick
                    assert not frame.array.flags.writeable
                    first = frame.array.reshape(-1)[:1].copy().view(np.uint8)
                    assert first[0] == frame.tick % 256, (name, first, frame.tick)
                    assert frame.header.world_from_sensor.translation_m[2] == frame.tick
        """)

    def test_an_array_keeps_its_sample_although_the_frame_is_gone(self):
        self.script("""
            with gantry.open("ego/card/rgb", domain="live") as topic:
                frame = topic.next(timeout=10)
                tick, array = frame.tick, frame.array[1:, 2:]
                before = array.copy()
                del frame
                for _ in range(20):
                    assert topic.next(timeout=10) is not None
                assert (array == before).all()
        """)

    def test_a_busy_wait_takes_frames_in_order_and_ends_in_time(self):
        self.script("""
            import time
            with gantry.open("ego/card/rgb", domain="live") as topic:
                seqs = [topic.next(timeout=10, busy_wait=10).header.seq for _ in range(20)]
                # A reader that the machine leaves waiting loses its oldest frames, and counts them.
                assert all(a < b for a, b in zip(seqs, seqs[1:])) and seqs[-1] - seqs[0] == 19 + topic.counts.lost, (seqs, topic.counts)
            with gantry.open("ego/card/collision", domain="live") as topic:
                while topic.poll() is not None:
                    pass
                began = time.monotonic()
                while topic.next(timeout=0.0, busy_wait=10, or_none=True) is not None:
                    pass
                assert time.monotonic() - began < 10
        """)

    def test_the_newest_is_newer_and_skips_are_counted(self):
        self.script("""
            import time
            with gantry.open("ego/card/imu", domain="live") as topic:
                last, taken, gap = topic.next(timeout=10), 1, 0
                # A writer that the machine leaves waiting needs longer for three frames.
                while gap <= 2 and taken < 300:
                    time.sleep(0.2)
                    newer, taken = topic.latest(timeout=10), taken + 1
                    last, gap = newer, newer.tick - last.tick
                assert gap > 2, gap
                assert topic.counts.skipped >= 2 and topic.counts.taken == taken, topic.counts
        """)

    def test_sync_gives_frames_of_one_tick(self):
        self.script("""
            names = ["ego/card/rgb", "ego/card/depth", "ego/card/lidar"]
            with gantry.sync(names, domain="live") as rows:
                for _ in range(5):
                    row = rows.next(timeout=10)
                    assert {row[name].tick for name in names} == {row.tick}
                    del row
        """)

    def test_the_domain_comes_from_the_environment(self):
        self.script("""
            with gantry.open("ego/card/rgb") as topic:
                assert topic.next(timeout=10) is not None
            assert gantry.snapshot().tick > 0 and len(gantry.topics()) > 15
        """)
        self.script("""
            try:
                gantry.open("ego/card/rgb", timeout=0)
            except gantry.NoSuchTopicError as error:
                assert 'nothing runs on domain "elsewhere"' in str(error), error
            else:
                raise AssertionError("the environment's domain was not taken")
        """, GANTRY_DOMAIN="elsewhere")

    def test_the_world_of_a_frame_is_that_of_its_tick(self):
        self.script("""
            with gantry.open("ego/card/rgb") as topic:
                found = 0
                while found < 10:
                    frame = topic.latest(timeout=10)
                    try:
                        world = gantry.snapshot_at(frame.tick)
                    except gantry.GantryError as error:
                        # The first call begins to follow, and the machine may leave this process waiting.
                        assert "is gone" in str(error), error
                        continue
                    finally:
                        tick, frame = frame.tick, None
                    assert world.tick == tick and world.actor(7)["world_from_actor"]["translation_m"][0] == tick
                    found += 1
                try:
                    gantry.snapshot_at(1)
                except gantry.GantryError as error:
                    assert "the snapshot of tick 1 is gone" in str(error), error
                else:
                    raise AssertionError("a tick before the first call was there")
                try:
                    gantry.snapshot_at(10**9, timeout=0.05)
                except gantry.GantryError as error:
                    assert "did not come within 0.05 s" in str(error), error
                else:
                    raise AssertionError("a tick of the future was there")
            with gantry.sync(["ego/card/rgb", "ego/card/imu"], snapshots=True) as rows:
                for _ in range(10):
                    row = rows.next(timeout=10)
                    assert row.snapshot is None or row.snapshot.tick == row.tick
                    del row
                assert rows.next(timeout=10).snapshot is not None
        """)

    def test_a_time_out_of_sync_loses_no_frame(self):
        self.script("""
            with gantry.sync(["ego/card/rgb", "ego/card/lidar"]) as rows:
                ticks = []
                while len(ticks) < 5:
                    row = rows.next(timeout=0.001, or_none=True)
                    ticks += [row.tick] if row is not None else []
                    del row
                lost = sum(topic.counts.lost for topic in rows._topics.values())
                assert ticks[-1] - ticks[0] <= 4 + lost, (ticks, lost)
        """)

    def test_tasks_of_an_event_loop_wait_without_a_thread(self):
        self.script("""
            import asyncio, threading, time

            async def read(topic, n):
                seqs = []
                async for frame in topic:
                    seqs.append(frame.seq)
                    del frame
                    if len(seqs) == n:
                        return seqs

            async def main():
                turns = 0
                async def others():
                    nonlocal turns
                    while True:
                        await asyncio.sleep(0.001)
                        turns += 1
                with gantry.open("ego/card/rgb") as rgb, gantry.open("ego/card/imu") as imu, gantry.sync(["ego/card/depth", "ego/card/lidar"]) as rows:
                    beside = asyncio.create_task(others())
                    used = time.process_time()
                    read_rgb, read_imu = await asyncio.gather(read(rgb, 20), read(imu, 20))
                    used = time.process_time() - used
                    assert all(a < b for a, b in zip(read_rgb, read_rgb[1:])) and len(read_imu) == 20
                    n = 0
                    async for row in rows:
                        n += 1
                        assert row["ego/card/depth"].tick == row["ego/card/lidar"].tick
                        del row
                        if n == 5:
                            break
                    assert await imu.anext(timeout=10) is not None
                    beside.cancel()
                assert turns > 20 and threading.active_count() == 1, (turns, threading.active_count())
                # A loop that is always busy would use all of the 400 ms that 20 frames take.
                assert used < 0.2, used

            async def closing():
                topic = gantry.open("ego/card/collision")
                async def read_all():
                    async for _ in topic:
                        pass
                task = asyncio.create_task(read_all())
                await asyncio.sleep(0.05)
                topic.close()
                await asyncio.wait_for(task, 10)

            asyncio.run(main())
            asyncio.run(closing())
        """)

    def test_threads_share_a_topic_and_each_frame_goes_to_one(self):
        self.script("""
            import threading, time
            with gantry.open("ego/card/rgb") as topic:
                seen, lock = [], threading.Lock()
                def read():
                    for _ in range(15):
                        seq = topic.next(timeout=10).seq
                        with lock:
                            seen.append(seq)
                threads = [threading.Thread(target=read) for _ in range(3)]
                turns = 0
                for thread in threads:
                    thread.start()
                while any(thread.is_alive() for thread in threads):
                    turns += 1          # waiting threads have let go of the global lock
                    time.sleep(0.001)
                for thread in threads:
                    thread.join()
                assert len(seen) == len(set(seen)) == 45 and turns > 50, (len(seen), turns)
                assert max(seen) - min(seen) == 44 + topic.counts.lost, topic.counts
            closed = gantry.open("ego/card/collision")
            ended = threading.Event()
            def iterate():
                for _ in closed:
                    pass
                ended.set()
            threading.Thread(target=iterate, daemon=True).start()
            time.sleep(0.05)
            closed.close()
            assert ended.wait(10), "closing a topic ends the loops over it"
        """)

    def test_a_loop_waits_for_a_writer_that_stands_still_and_ends_with_it(self):
        """However it is read: by samples, the newest of them, ticks of several topics, or in an event loop."""
        ways = {
            "for frame in gantry.open('ego/card/rgb'):": "",
            "for frame in gantry.open('ego/card/imu').newest():": "",
            "for frame in gantry.sync(['ego/card/rgb', 'ego/card/lidar']):": "",
            "async for frame in gantry.open('ego/card/depth'):": "async",
            "async for frame in gantry.sync(['ego/card/rgb', 'ego/card/imu']):": "async",
        }
        readers = []
        for loop in ways:
            readers.append(self.start(f"""
                import asyncio
                from gantry import _patience
                # How long a restart may take.
                _patience.PATIENCE = 1.0

                {'async ' if loop.startswith('async') else ''}def read():
                    {loop}
                        print(frame.tick, flush=True)
                        del frame
                    print("ended", flush=True)

                asyncio.run(read()) if asyncio.iscoroutinefunction(read) else read()
            """))
        last = [int(reader.stdout.readline()) for reader in readers]
        self.card.send_signal(signal.SIGSTOP)
        # Longer than the patience: a writer that stands still has not ended.
        time.sleep(3.0)
        self.card.send_signal(signal.SIGCONT)
        for reader, before in zip(readers, last):
            while int(reader.stdout.readline()) <= before + 100:
                pass
        self.card.kill()
        self.card.wait()
        for reader in readers:
            self.assertTrue(self.finish(reader).endswith("ended\n"))

    def test_what_does_not_come_in_time_is_an_exception_or_none(self):
        self.script("""
            import asyncio
            with gantry.publish("mine/silent", "text") as writer, gantry.open("mine/silent", result="text") as topic:
                for take in (topic.next, topic.latest):
                    assert take(0.05, or_none=True) is None
                    try:
                        take(0.05)
                    except gantry.TimedOutError as error:
                        assert isinstance(error, TimeoutError) and isinstance(error, gantry.GantryError)
                        assert "'live/mine/silent' sent nothing within 0.05 s; its writer sends nothing" in str(error), error
                    else:
                        raise AssertionError("nothing came, and no exception")
                async def main():
                    assert await topic.anext(0.05, or_none=True) is None
                    try:
                        await topic.anext(0.05)
                    except gantry.TimedOutError:
                        return
                    raise AssertionError("nothing came, and no exception")
                asyncio.run(main())
                with gantry.sync(["ego/card/rgb", "mine/silent"]) as rows:
                    assert rows.next(0.05, or_none=True) is None
                    try:
                        rows.next(0.05)
                    except gantry.TimedOutError as error:
                        assert "no tick was complete within 0.05 s; mine/silent sent nothing" in str(error), error
                    else:
                        raise AssertionError("nothing came, and no exception")
                writer.close()
                try:
                    topic.next(0.05)
                except gantry.TimedOutError as error:
                    assert "nobody writes it" in str(error), error
            try:
                gantry.document("world/catalogue", timeout=0.05)
            except gantry.NoSuchTopicError:
                pass
        """)

    def test_whatever_waits_has_the_same_patience(self):
        self.script("""
            import inspect
            assert gantry.PATIENCE == 10.0
            waiting = [gantry.open, gantry.sync, gantry.attach, gantry.lockstep, gantry.snapshot, gantry.snapshot_at, gantry.document, gantry.command]
            waiting += [gantry.world, gantry.ego, gantry.spawn, gantry.pause, gantry.Topic.next, gantry.Topic.latest, gantry.Topic.anext, gantry.Sync.next]
            for call in [*waiting, gantry.Sync.anext, gantry.Lockstep.next, gantry.Lockstep.anext, gantry.LockstepRows.next]:
                assert inspect.signature(call).parameters["timeout"].default == gantry.PATIENCE, call
        """)

    def test_a_script_may_be_started_before_what_it_reads(self):
        early = self.start("""
            print("waiting", flush=True)
            # Their usual patience is ten seconds, which a busy machine may need to start a process.
            with gantry.open("late/text", result="text", timeout=60) as topic:
                print(topic.next(timeout=60).text, flush=True)
            print(gantry.snapshot("later", timeout=60).tick)
        """)
        self.assertEqual(early.stdout.readline(), "waiting\n")
        late = self.start("""
            with gantry.publish("late/text", "text") as topic:
                while topic.n_readers == 0:
                    pass
                topic.send("good morning")
                # What a writer has sent goes with it for readers that have not looked yet.
                input()
        """)
        self.assertEqual(early.stdout.readline(), "good morning\n")
        late.stdin.write("end\n")
        self.finish(late)
        later = subprocess.Popen([TEST_CARD, "later", "600"], cwd=self.folder, stdout=subprocess.DEVNULL)
        try:
            self.assertGreater(int(self.finish(early)), 0)
        finally:
            later.kill()
            later.wait()

    def test_ctrl_c_ends_a_wait(self):
        process = self.start("""
            topic = gantry.open("ego/card/collision")
            while topic.poll() is not None:
                pass
            try:
                print("waiting", flush=True)
                while True:
                    topic.next()
            except KeyboardInterrupt:
                print("interrupted")
        """)
        self.assertEqual(process.stdout.readline(), "waiting\n")
        process.send_signal(signal.SIGINT)
        self.assertIn("interrupted", self.finish(process))

    def test_a_forked_child_is_refused_and_takes_nothing_away(self):
        self.script("""
            import os, multiprocessing
            with gantry.open("ego/card/rgb") as topic:
                frame = topic.next(timeout=10)
                for act in (lambda: topic.next(timeout=1), lambda: gantry.open("ego/card/depth"), gantry.snapshot, lambda: gantry.command({"do": "ping"})):
                    child = os.fork()
                    if child == 0:
                        try:
                            act()
                        except gantry.GantryError as error:
                            os._exit(0 if "was forked" in str(error) and "spawn" in str(error) else 2)
                        os._exit(1)
                    assert os.waitpid(child, 0)[1] == 0
                child = os.fork()
                if child == 0:
                    del frame, topic        # and the end of the interpreter: nothing of the parent's may go
                    raise SystemExit(0)
                assert os.waitpid(child, 0)[1] == 0
                assert frame.array.shape == (48, 64, 4)
                for _ in range(10):
                    frame = topic.next(timeout=10)
                    assert frame is not None
                    frame = None
        """)

    def test_other_libraries_take_an_array_without_a_copy(self):
        self.script("""
            with gantry.open("ego/card/depth") as topic, gantry.open("ego/card/lidar") as cloud:
                frame = topic.next(timeout=10)
                other = np.from_dlpack(frame)
                assert np.shares_memory(other, frame.array) and not other.flags.writeable
                assert frame.__dlpack_device__() == (1, 0)
                try:
                    np.from_dlpack(cloud.next(timeout=10))
                except BufferError:
                    pass
                else:
                    raise AssertionError("a structured array was handed over")
        """)

    def test_traps_are_explained(self):
        self.script("""
            try:
                gantry.open("ego/nope/rgb", domain="live", timeout=0)
            except gantry.NoSuchTopicError as error:
                assert "there is ego/card/rgb" in str(error), error
            else:
                raise AssertionError("opened a topic that is not there")
            try:
                gantry.open("ego/card/rgb", domain="nobody", timeout=0)
            except gantry.NoSuchTopicError as error:
                assert 'nothing runs on domain "nobody"' in str(error), error
            held = []
            with gantry.open("ego/card/rgb", domain="live") as topic:
                try:
                    while len(held) < 9:
                        held.append(topic.next(timeout=10))
                except gantry.BorrowLimitError as error:
                    assert len(held) == 3 and "keep frame.copy()" in str(error), error
                else:
                    raise AssertionError("no borrow limit")
        """)

    def test_world_documents_and_commands(self):
        self.script("""
            snapshot = gantry.snapshot("live")
            assert snapshot.actor(7)["world_from_actor"]["translation_m"][0] == snapshot.tick
            assert snapshot.vehicle_parts["gear"].tolist() == [3]
            assert gantry.document("world/info", "live").json()["map"] == "TestCard"
            assert gantry.command({"do": "ping"}, domain="live") == [{"is": "pong", "version": "test_card"}]
            try:
                gantry.command({"do": "fly"}, domain="live")
            except gantry.GantryError as error:
                assert "unknown variant" in str(error), error
            else:
                raise AssertionError("an unknown command was taken")
        """)


if __name__ == "__main__":
    unittest.main()
