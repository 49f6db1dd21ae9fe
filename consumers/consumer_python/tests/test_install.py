"""A native module that is missing or old is told in a sentence."""

import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

PACKAGE = pathlib.Path(__file__).resolve().parent.parent / "python" / "gantry"


class Installation(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        shutil.copytree(PACKAGE, self.folder / "gantry", ignore=shutil.ignore_patterns("_native*", "__pycache__"))

    def tearDown(self):
        shutil.rmtree(self.folder)

    def failure(self):
        code = f"import sys; sys.path.insert(0, {str(self.folder)!r}); import gantry"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=self.folder)
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        return done.stderr.splitlines()[-1]

    def test_a_missing_native_module_is_told_with_what_to_do(self):
        sentence = self.failure()
        self.assertIn("gantry's native module cannot be loaded", sentence)
        self.assertIn("pip install ./consumers/consumer_python", sentence)

    def test_an_old_native_module_is_told_with_what_to_do(self):
        (self.folder / "gantry" / "_native.py").write_text("INTERFACE = 0\nSCHEMA_VERSION = 1\n")
        sentence = self.failure()
        self.assertIn("has interface 0 and schema 1, this package needs", sentence)
        self.assertIn("./gantry up", sentence)


if __name__ == "__main__":
    unittest.main()
