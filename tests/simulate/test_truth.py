"""Reading a truth: messages where it is wrong; tests of the replicas read sound ones."""

import pytest
import yaml

from imuloop.core.errors import ImuloopError
from imuloop.simulate.truth import read_truth


@pytest.mark.parametrize(
    ("part", "key", "message"),
    [
        ("gyroscope", "biass", "biass"),
        ("sessions", None, "not a truth"),
        (None, "gravitiy", "gravitiy"),
    ],
)
def test_says_what_is_wrong(repository, tmp_path, part, key, message):
    truth = yaml.safe_load((repository / "data/replicas/iphone_6.yaml").read_text())
    if key:
        (truth[part] if part else truth)[key] = 1
    else:
        truth[part] = None
    (tmp_path / "truth.yaml").write_text(yaml.safe_dump(truth))
    with pytest.raises(ImuloopError, match=message):
        read_truth(tmp_path / "truth.yaml")
