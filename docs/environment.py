"""The Conda environment of the jobs: ``make environment`` writes it from locks/users.lock."""

import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
LOCK = REPOSITORY / "locks/users.lock"
FILE = REPOSITORY / "workflow/envs/imuloop.yaml"
HEAD = """# made by `make environment` from locks/users.lock
channels:
  - conda-forge
dependencies:
  - python =3.12
  - pip
  - pip:
"""


def environment():
    """Return the environment as text, YAML: all packages of the lock with their versions."""
    pins = re.findall(r"^([a-z0-9-]+==.*?) \\$", LOCK.read_text(), re.M)
    return HEAD + "".join(f'      - "{pin}"\n' for pin in pins)


if __name__ == "__main__":
    FILE.write_text(environment())
