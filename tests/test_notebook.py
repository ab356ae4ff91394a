"""The notebook runs, and gives what is stored in it."""

import json
import re

import numpy as np
import pytest

from notebook import code_cells, run, text

NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?"


@pytest.mark.usefixtures("undrawn")
def test_the_notebook_gives_what_is_stored_in_it(repository):
    stored = json.loads((repository / "docs/using.ipynb").read_text())
    for cell, outputs in zip(code_cells(stored), run(stored), strict=True):
        kinds = [out["output_type"] for out in cell["outputs"]]
        assert [out["output_type"] for out in outputs] == kinds
        found, expected = text(outputs), text(cell["outputs"])
        assert re.sub(NUMBER, "#", found) == re.sub(NUMBER, "#", expected)
        # another processor rounds otherwise
        values = [np.array(re.findall(NUMBER, each), dtype=float) for each in (found, expected)]
        np.testing.assert_allclose(*values, rtol=0.05, atol=0.05)
