"""What `gsid compare` prints of its bands."""

from types import SimpleNamespace

import pytest

from gsid.cli import compare

BAND = {"f_lo_hz": 1.0, "f_hi_hz": 3.0, "lines": "odd", "share": 0.9, "p_value": 1e-9, "db": -20.0}


@pytest.mark.parametrize(
    ("adequate", "where", "last"),
    [
        (True, [], "Model uncertainty left out"),
        (False, [], "The excess is spread over the whole band."),
        (False, [BAND], "1        3  odd"),
    ],
)
def test_bug_no_band_was_a_table_without_rows(capsys, adequate, where, last):
    facts = {"p_value": 0.006, "alpha": 0.05, "cost_per_dof": 1.158, "rms_error": 1.0, "noise_floor_rms": 1.0}
    result = SimpleNamespace(adequate=adequate, where=where, model_uncertainty="none", **facts)
    compare._print(result, "deg/s", "1 when only noise is left")
    shown = capsys.readouterr().out.rstrip("\n").splitlines()
    assert shown[-1].strip().startswith(last)
    assert ("f from [Hz]" in "\n".join(shown)) == bool(where)
