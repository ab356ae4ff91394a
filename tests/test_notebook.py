"""The notebook runs, and gives the output that is stored in it."""

import json
import re

import numpy as np
import pytest

from notebook import code_cells, run, text
from quick import hurry

NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?"


@pytest.mark.usefixtures("blank_figures")
def test_the_notebook_gives_what_is_stored_in_it(repository):
    stored = json.loads((repository / "docs/using.ipynb").read_text())
    with hurry("device"):
        results = run(stored)
    for cell, outputs in zip(code_cells(stored), results, strict=True):
        kinds = [out["output_type"] for out in cell["outputs"]]
        assert [out["output_type"] for out in outputs] == kinds
        printed = [text(cell_outputs) for cell_outputs in (outputs, cell["outputs"])]
        words = [re.sub(NUMBER, "#", cell_outputs) for cell_outputs in printed]
        assert words[0] == words[1]
        # another processor rounds otherwise
        values = [
            np.array(re.findall(NUMBER, cell_outputs), dtype=float) for cell_outputs in printed
        ]
        np.testing.assert_allclose(*values, rtol=0.05, atol=0.05)
