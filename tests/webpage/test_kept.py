"""What a page keeps in the study for its next reload."""

import json

from gsid.study.folder import Study


def test_what_was_kept_is_sent_again_and_the_study_can_be_opened(ask, server):
    assert json.loads(ask("GET", "/kept").text) == {}
    wanted = {"bench": {"values": {"rigid_body.gain": 7.5}}, "ticked": {"records/a.csv": False}}
    assert ask("POST", "/kept", wanted).code == 200
    assert json.loads(ask("GET", "/kept").text) == wanted
    assert Study(server.folder, create=False).steps == []


def test_what_is_no_object_or_too_long_is_refused(ask):
    for wrong in ("[1]", "no JSON", json.dumps({"a": "x" * 70_000})):
        assert ask("POST", "/kept", wrong).code == 400
    assert ask("POST", "/kept", {"a": 1}, origin="http://example.org").code == 403


def test_a_damaged_file_or_a_link_keeps_nothing_and_hurts_nothing(ask, server, tmp_path):
    place = server.folder / "page.json"
    place.unlink(missing_ok=True)
    place.write_text("{broken")
    assert json.loads(ask("GET", "/kept").text) == {}
    place.unlink()
    other = tmp_path / "other.json"
    other.write_text('{"secret": 1}')
    place.symlink_to(other)
    assert json.loads(ask("GET", "/kept").text) == {}
    assert ask("POST", "/kept", {"a": 1}).code == 400
    assert other.read_text() == '{"secret": 1}'
    place.unlink()
