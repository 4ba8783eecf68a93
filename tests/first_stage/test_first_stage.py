"""Blind trials with the first stage; more by `make first-stage-study`."""

import first_stage_study as study

SEED = 161  # a development seed


def test_coulomb_friction_is_named_and_nothing_in_its_place(tmp_path):
    """Without its family in the catalogue a trial has no name."""
    rows = study.judged(study.drawn(tmp_path, SEED, "single", 10), "single", 10, SEED)
    print(rows)
    assert rows[0]["hidden"] == ["coulomb_friction"]
    assert study.outcome(rows[0]) == "named right"
    assert study.outcome(rows[1]) in ("unknown", "none")


def test_the_study_goes_on_where_it_stopped_and_writes_its_table(tmp_path):
    page = tmp_path / "page.md"
    begin = study.BEGIN.format("first-stage-study")
    page.write_text(f"before\n{begin}\n{study.END}\nafter\n")
    common = ["--seed", str(SEED), "--foreign", "0", "--folder", str(tmp_path), "--page", str(page)]
    study.main(["--singles", "0", "--nulls", "1", *common])
    written = (tmp_path / "results.jsonl").stat().st_mtime_ns
    study.main(["--singles", "0", "--nulls", "1", *common])
    assert (tmp_path / "results.jsonl").stat().st_mtime_ns == written
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "| nothing hidden | 1 |" in text


def test_bug_the_times_of_the_table_needed_the_same_steps_in_all_trials():
    row = {"kind": "null", "hidden": [], "drop": 0.0, "kind of conclusion": "none", "effects": []}
    row |= {"order": ["coulomb_friction"], "processor_s": 1.0}
    rows = [row | {"seconds": {"scan": 0.1, "model error": 0.5}}, row | {"seconds": {"scan": 0.3}}]
    assert "scan 200 ms, model error 500 ms" in study.table(rows, "make it")
