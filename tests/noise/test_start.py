"""What the stage loads before it works: each costs a job tenths of a second."""

import os
import subprocess
import sys

LONG = ("pandas", "scipy.stats", "scipy.signal", "scipy.optimize", "scipy.interpolate")
# put off until they are used
PARTS = ("numpy.f2py.crackfortran", "numpy.testing._private")


def test_what_takes_long_to_load_is_not_loaded():
    code = (
        "import sys, imuloop.noise.noise\n"
        f"print([name for name in {LONG + PARTS} if name in sys.modules])\n"
        "import numpy\n"
        "numpy.testing.assert_allclose(1.0, 1.0)\n"
        "print(numpy.f2py.crackfortran.__name__)\n"
    )
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    assert done.stdout.split("\n")[:2] == ["[]", "numpy.f2py.crackfortran"]
