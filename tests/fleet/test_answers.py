"""The version of the answers changes when an answer does: kept results of a fleet are then computed again."""

import json
import os
from pathlib import Path

import pytest
from fleet_works import write_records

from gsid.cli.main import main
from gsid.fleet.address import ANSWERS

KEPT = Path(__file__).parent / "answers.json"
VERBS = {"diagnose": ["--fast", "--output", "rate"], "fit": ["--order", "1/0"]}
# Other libraries and processors change the last digits, and an optimum is found to about the root of them.
TOLERANCE = 1e-4


def numbers(value, path=""):
    """Path and value of every number in an answer; times are left out."""
    if isinstance(value, dict):
        return [
            one for key, item in value.items() if key != "seconds" for one in numbers(item, f"{path}.{key}")
        ]
    if isinstance(value, list):
        return [one for i, item in enumerate(value) for one in numbers(item, f"{path}.{i}")]
    return [(path, value)] if isinstance(value, int | float | str) else []


def figures(capsys, tmp_path):
    """A few figures of each verb on one record."""
    record = write_records(tmp_path, 1) / "SN0000/record.npz"
    kept = {}
    for verb, words in VERBS.items():
        assert main([verb, *words, "--json", str(record)]) == 0
        found = dict(numbers(json.loads(capsys.readouterr().out)))
        wanted = ("verdict", "cost", "cost_per_dof", ".value", "num.0", "std")
        kept[verb] = {path: value for path, value in found.items() if path.endswith(wanted)}
    return kept


def test_answers_are_those_of_their_version(capsys, tmp_path):
    found = {"answers": ANSWERS, **figures(capsys, tmp_path)}
    if os.environ.get("GSID_UPDATE_SNAPSHOTS") == "1":
        KEPT.write_text(json.dumps(found, indent=1) + "\n")
    kept = json.loads(KEPT.read_text())
    hint = (
        "an answer changed: increase ANSWERS in gsid/fleet/address.py, then run with GSID_UPDATE_SNAPSHOTS=1"
    )
    assert kept["answers"] == ANSWERS, "run with GSID_UPDATE_SNAPSHOTS=1"
    for verb in VERBS:
        assert kept[verb]
        assert kept[verb].keys() == found[verb].keys(), hint
        for path, value in kept[verb].items():
            same = value if isinstance(value, str) else pytest.approx(value, rel=TOLERANCE, abs=1e-9)
            assert found[verb][path] == same, f"{verb} {path}: {hint}"
