"""What the stage loads before it works: each costs a job tenths of a second."""

import os
import subprocess
import sys

LONG = ("pandas", "scipy.stats", "scipy.signal", "scipy.optimize", "scipy.interpolate")
# put off until they are used
PARTS = ("numpy.f2py.crackfortran", "numpy.testing._private")


def test_what_takes_long_to_load_is_not_loaded():
    code = f"import sys, imuloop.diagnose.diagnose\nprint({{*{LONG + PARTS}}} & {{*sys.modules}})"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    assert done.stdout == "set()\n"
