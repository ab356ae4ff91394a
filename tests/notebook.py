"""Run a notebook of plain Python cells without a kernel, and keep what its cells give.

``python tests/notebook.py docs/using.ipynb`` runs it and stores the outputs in it.
"""

import base64
import contextlib
import io
import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def run(notebook):
    """Return the outputs of each code cell: lines printed, then pictures left open."""
    names, outputs = {"__name__": "__main__"}, []
    # a cell may go to another folder; the caller stays where it is
    with contextlib.chdir("."):
        for number, cell in enumerate(code_cells(notebook)):
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
            outputs.append([*_stream(printed.getvalue()), *_pictures()])
    return outputs


def code_cells(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def text(outputs):
    return "".join("".join(out["text"]) for out in outputs if out["output_type"] == "stream")


def _stream(printed):
    if not printed:
        return []
    return [{"output_type": "stream", "name": "stdout", "text": printed.splitlines(True)}]


def _pictures():
    outputs = []
    for number in plt.get_fignums():
        png = io.BytesIO()
        plt.figure(number).savefig(png, format="png", dpi=64, metadata={"Software": None})
        data = {"image/png": base64.b64encode(png.getvalue()).decode()}
        outputs.append({"output_type": "display_data", "metadata": {}, "data": data})
    plt.close("all")
    return outputs


if __name__ == "__main__":
    path = Path(sys.argv[1])
    stored = json.loads(path.read_text())
    for count, (cell, outputs) in enumerate(zip(code_cells(stored), run(stored), strict=True), 1):
        cell.update(outputs=outputs, execution_count=count)
    path.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n")
