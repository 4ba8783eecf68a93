"""The demo runs whole, over real pseudo-terminals, and must show what it claims."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import gsid.demo
from gsid.cli.main import main
from gsid.demo.hidden import SIZES, draw
from gsid.demo.linear import compared_with_truth, mode_pole
from gsid.demo.missing import excitations
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.rig.axis import HIDDEN, SimulatedAxis, hidden_parameters
from gsid.study.folder import Study

pytestmark = pytest.mark.xdist_group("demo")  # the module's fixture is made once
README = Path(__file__).parents[2] / "README.md"
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """One run with the default seed: its result, and the words said on the way."""
    said = []
    return gsid.demo.demo(tmp_path_factory.mktemp("user") / "demo", on_step=said.append), said


@pytest.fixture
def command(shown, monkeypatch, capsys):
    """The command without a run of its own."""

    def run(*arguments):
        monkeypatch.chdir(shown[0].report.parents[1])
        monkeypatch.setattr(gsid.demo, "demo", lambda *args, **kwargs: shown[0])
        code = main(["demo", *arguments])
        return code, capsys.readouterr().out

    return run


def test_it_shows_what_it_claims(shown, command):
    result, _ = shown
    assert result.passed, result.checks
    code, out = command("--json")
    numbers = json.loads(out)
    assert code == 0
    assert all(numbers["checks"].values())
    assert len(numbers["checks"]) == 9
    assert numbers["linear"]["adequate"]
    assert not numbers["friction"]["adequate"]
    hidden = numbers["hidden"]
    assert hidden["effect"] in hidden["diagnosis"]["found"][0]["effects"]
    assert hidden["held_out_over_noise"] <= 1.1
    assert not hidden["compare"]["adequate"]
    folder = result.report.parent
    for name in ("linear.csv", "friction.csv", "hidden8.csv", "linear_model.json", "friction_model.json"):
        assert (folder / name).stat().st_size > 0
    assert PlantModel.load(folder / "found.json").effects[-1].id == hidden["effect"]
    linear = PlantModel.load(folder / "initial_model.json")
    assert hidden["effect"] not in [effect.id for effect in linear.effects]


def test_it_prints_what_the_readme_shows(command):
    """Words as they stand; figures to 10 %: seeded noise, and an optimiser's last steps."""
    code, out = command()
    assert code == 0
    shown = re.search(r"^```demo\n(.*?)^```$", README.read_text(), re.DOTALL | re.MULTILINE)[1]
    start = out.index(shown.splitlines()[0].split("(")[0])
    for part in shown.split("...\n"):
        n_lines = len(part.splitlines())
        found = out[start:].splitlines()[:n_lines] if start >= 0 else out.splitlines()[-n_lines:]
        printed, start = "\n".join(found), -1
        assert NUMBER.sub("#", printed).split() == NUMBER.sub("#", part).split()
        values = [[float(number) for number in NUMBER.findall(text)] for text in (printed, part)]
        np.testing.assert_allclose(*values, rtol=0.1, atol=1e-12)


def test_the_answer_was_hashed_before_the_first_measurement_and_printed_last(shown, command):
    result, said = shown
    answer = (result.report.parent / "hidden.json").read_bytes()
    sha256 = hashlib.sha256(answer).hexdigest()
    first_hidden = next(text for text in said if text.startswith("hidden:"))
    assert sha256 in first_hidden
    effect = json.loads(answer)["effect"]
    searched = next(i for i, text in enumerate(said) if "transforming the records" in text)
    assert not any(effect in text for text in said[:searched])
    assert command()[1].splitlines()[-2] == result.search.answer_sentence
    page = result.report.read_text()
    assert sha256 in page
    answered, folded = page.rindex(result.search.answer_sentence), page.index("<details")
    assert page.rindex("<svg", 0, folded) < answered < folded  # below the pictures


def test_the_last_line_opens_a_study_that_has_the_records_and_not_the_answer(shown, command):
    study = Study(shown[0].study)
    assert command()[1].splitlines()[-1] == "Find it by clicks: gsid studio --folder demo/study1"
    assert sorted(study.files) == [f"records/hidden{i}.csv" for i in range(1, 9)]
    answer = shown[0].search.hidden.effect
    assert not any(answer in path.read_text() for path in study.folder.rglob("*") if path.is_file())


def test_a_failed_demo_is_reported(shown, command):
    checks = shown[0].checks
    checks["the hidden effect is named"] = False
    try:
        code, out = command()
    finally:
        checks["the hidden effect is named"] = True
    assert code == 1
    assert "  NO   the hidden effect is named" in out


def test_every_effect_that_can_be_drawn_can_be_hidden_and_is_drawn():
    drawn = {draw(seed).effect for seed in range(1, 61)}
    assert drawn == set(SIZES) == set(HIDDEN)
    for seed in range(1, 61):
        hidden = draw(seed)
        assert hidden == draw(seed)
        SimulatedAxis(**hidden_parameters(hidden.effect, hidden.params))  # refuses what is out of range


def test_the_excitations_keep_to_the_limits_of_the_drive():
    """Of the axis, +-179, in all seeds of a few: rounding aside, what is asked is applied."""
    for seeds in ([1, 2, 3, 4], [5, 6, 7, 8]):
        for multisine in excitations(seeds):
            assert np.max(np.abs(multisine.table())) < 179


def test_a_wrong_model_stands_out_beside_the_truth():
    truth = {"num": [2.0, 0.0], "den": [1.0, 3.0, 900.0], "delay_s": 0.005, "parameters": {"mode_f_hz": 4.7}}
    cov = np.diag([0.01, 1.0, 0.01, 0.01, 1e-10])
    model = RationalModel([2.5, 0.0], [1.0, 3.0, 900.0], 0.005, cov=cov, free_delay=True)
    rows = {row.name: row for row in compared_with_truth(model, truth)}
    assert rows["num, s¹"].n_sigma == pytest.approx(5)
    assert rows["delay"].n_sigma == pytest.approx(0)
    assert rows["mode"].estimate == pytest.approx(30 / (2 * np.pi))


def test_a_model_without_complex_poles_has_no_mode():
    with pytest.raises(ValueError, match="complex"):
        mode_pole(np.array([-1.0, -2.0]), 179.0)
