"""What the page shares with the command line: experiments, and the script that repeats the study."""

import pytest

from gsid.study.folder import Study

RECORD = "# fs_hz: 100\nu,y\n" + "1,{0}\n2,1\n" * 50


def test_records_of_one_drop_are_one_experiment(ask, server):
    for name, query in (("one", ""), ("two", "&with=last"), ("three", "&with=other")):
        assert (
            ask("POST", f"/records?name={name}.csv{query}", RECORD.format(len(name) + ord(name[0]))).code
            == 200
        )
        if name == "two":
            assert Study(server.folder).last_experiment == ["records/one.csv", "records/two.csv"]
    assert Study(server.folder).last_experiment == ["records/three.csv"]


def test_the_script_of_the_study_is_saved(ask, server):
    answer = ask("GET", "/study.py")
    assert (answer.code, answer.text.splitlines()[0][:9]) == (200, "# Repeats")
    assert "attachment" in answer.headers["Content-Disposition"]
    for name in Study(server.folder).files:
        assert name in answer.text


@pytest.mark.parametrize("wrong", [{"cookie": None}, {"host": "example.com"}])
def test_the_script_needs_the_token(ask, wrong):
    assert ask("GET", "/study.py", **wrong).code in (400, 403)
