"""Each row of `cases.yaml`: its lines and no others, its rows, its figures."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from imuloop.core.samples import CHANNELS, TEMPERATURE
from ingest import harm, logs
from ingest.figures import check_figures

CASES = yaml.safe_load(Path(__file__).with_name("cases.yaml").read_text(encoding="utf-8"))
KEYS = {"log", "harm", "says", "reason", "drops", "within", "figures", "declared"}
LOGS = [
    pytest.param(log, case, id=f"{name}, {log}")
    for name, case in CASES.items()
    for log in (case["log"] if isinstance(case["log"], list) else [case["log"]])
]


@pytest.mark.parametrize(("log", "case"), LOGS)
def test_a_harmed_log_is_named_and_nothing_else(run, log, case):
    assert {*case} <= KEYS
    # a sound log has its name, or its name and arguments
    name, arguments = (log, ()) if isinstance(log, str) else next(iter(log.items()))
    table = harm.harmed(getattr(logs, name)(*arguments), case.get("harm", {}))
    declared = case.get("declared", {})
    kind = {"kind": "static"} if log == "rest" else {}
    samples, quality, *_ = run(table, **kind | declared)
    lines, reason = quality["reasons"] + quality["warnings"], case.get("reason", "")
    says = case.get("says", [reason] if reason else [])
    assert quality["status"] == ("rejected" if reason else "ok"), lines
    assert reason in " ".join(quality["reasons"]), lines
    if says != "any":
        assert len(lines) == len(says), lines
        assert all(text in line for text, line in zip(says, lines, strict=True)), lines
    check_figures(quality, case.get("figures", {}))
    if reason:
        assert len(samples) == 0
    elif case.get("drops") != "any" and "units" not in declared:
        kept = table.drop(index=case.get("drops", []))
        kept = kept[~kept.index.duplicated()]
        names = [*CHANNELS, *({TEMPERATURE} & {*table})]
        np.testing.assert_array_equal(samples[names], kept[names])
        if "within" in case:
            true = (kept.index - kept.index[0]) / 100
            np.testing.assert_allclose(samples.t, true, rtol=0, atol=case["within"])
