"""What the live tests share: a private iceoryx2 root and prefix, and scripts in processes of their own.

iceoryx2 reads its configuration once per process, from the working directory.
"""

import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import textwrap
import unittest

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent / "python"
TEST_CARD = pathlib.Path(os.environ.get("GANTRY_TEST_CARD", HERE.parents[2] / "target" / "release" / "examples" / "test_card"))
PATIENCE_SECS = 120


class LiveCase(unittest.TestCase):
    """A test in a folder and on a prefix of its own."""

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.prefix = f"gpy{os.getpid()}_"
        (self.folder / "config").mkdir()
        config = f'[global]\nroot-path = "{self.folder}/iox"\nprefix = "{self.prefix}"\n'
        (self.folder / "config" / "iceoryx2.toml").write_text(config)

    def tearDown(self):
        left = self.left()
        for path in left:
            path.unlink()
        shutil.rmtree(self.folder)
        self.assertEqual([path.name for path in left if not path.name.endswith(".global_mgmt")], [], "something is left in /dev/shm")

    def left(self):
        """Files of this test in shared memory."""
        return list(pathlib.Path("/dev/shm").glob(self.prefix + "*"))

    def start(self, text, **environment):
        """Starts a script; `import gantry, numpy as np` stands before it."""
        env = {**os.environ, "PYTHONPATH": str(SOURCE), "GANTRY_DOMAIN": "live", **environment}
        code = "import gantry, numpy as np\n" + textwrap.dedent(text)
        return subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=self.folder,
            env=env,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.PIPE,
            # What a shell started in the background ignores Ctrl-C, and hands that on.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def finish(self, process, code=0):
        """Waits for a script, which must end with `code`, and returns its output."""
        try:
            output, _ = process.communicate(timeout=PATIENCE_SECS)
        except subprocess.TimeoutExpired:
            process.kill()
            output, _ = process.communicate()
            self.fail(f"the script did not end:\n{output}")
        self.assertEqual(process.returncode, code, output)
        return output

    def script(self, text, **environment):
        """Runs a script, and fails with its output if it fails."""
        return self.finish(self.start(text, **environment))


class CardCase(LiveCase):
    """A test beside the example `test_card`, which publishes every modality on the domain `live`."""

    def setUp(self):
        super().setUp()
        self.assertTrue(TEST_CARD.exists(), f"{TEST_CARD} is missing; build it: cargo build --release -p schema_bus --example test_card")
        self.card = subprocess.Popen([TEST_CARD, "live", "600"], cwd=self.folder, stdout=subprocess.PIPE, text=True)
        self.assertIn("test card on live", self.card.stdout.readline())

    def tearDown(self):
        self.card.kill()
        self.card.wait()
        self.card.stdout.close()
        # Nobody is left to clean up after the killed card.
        for path in self.left():
            path.unlink()
        super().tearDown()
