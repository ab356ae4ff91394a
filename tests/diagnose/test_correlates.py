"""What a residual goes with."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import planned, recording
from diagnose.models import diagnosed
from imuloop.core.sphere import fibonacci_lattice
from imuloop.diagnose.records.probes import harmonics
from imuloop.simulate.truth import example_truth


@pytest.mark.parametrize("degree", [3, 4, 5])
def test_harmonics_are_orthogonal_to_each_other_and_to_lower_degrees(degree):
    u = fibonacci_lattice(20000)
    columns = harmonics(u, degree)
    lower = np.column_stack([harmonics(u, d) for d in range(degree)])
    gram = columns.T @ columns / len(u)
    np.testing.assert_allclose(gram, np.diag(np.diag(gram)), atol=2e-4)
    np.testing.assert_allclose(lower.T @ columns / len(u), 0, atol=2e-4)


def test_a_pattern_of_attitude_outside_the_library_is_unexplained_and_named(no_limits):
    degree = 5
    pattern = np.random.default_rng(0).normal(size=2 * degree + 1)

    def extra(channels):
        u = channels.output / np.linalg.norm(channels.output, axis=1, keepdims=True)
        return 0.006 * (harmonics(u, degree) @ pattern)[:, None] * u

    truth = planned(example_truth(), poses=70)
    truth = replace(truth, accelerometer=replace(truth.accelerometer, extra=extra))
    found = diagnosed(truth, recording(truth, 0), tests=20, folds=5)
    content = found.contents["accelerometer"]
    assert (content["verdict"], content["effects"]) == ("unexplained", [])
    first = content["correlates"][0]
    assert first["name"] == f"harmonics_{degree}"
    assert first["share"] > 0.5
