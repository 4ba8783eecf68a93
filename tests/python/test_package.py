"""The package's own names: verbs that are functions and modules, loaded when they are first used."""

import inspect
import subprocess
import sys

import numpy as np
import pytest
from plants import axis_record, plant

import gsid

SEED = 20260411
VERBS = ("compare", "diagnose", "fit", "frf")


@pytest.fixture(scope="module")
def record():
    print("seed", SEED)
    u = np.random.default_rng(SEED).standard_normal(300)
    return axis_record(u, 4, 0.01, SEED, gain=7.4, viscous_rate=11.0)


@pytest.fixture(scope="module")
def model():
    return plant({"rigid_body": {"gain": 7.4}, "viscous_friction": {"rate": 11.0}})


def test_the_verbs_of_the_package(model, record):
    compared = gsid.compare(model, [record])
    assert compared.adequate
    assert compared.plot().axes
    assert gsid.frf(record).plot().axes
    assert gsid.fit(gsid.frf(record), "1/0", delay="none").plot().axes
    assert gsid.fit_plant(model, record).converged
    diagnosis = gsid.diagnose(model, record)
    assert diagnosis.verdict == "adequate"
    added = gsid.add("quadratic_drag", model, record)
    assert added.ladder.plot().axes
    assert len(gsid.undo(added.model).effects) == 2
    assert gsid.torque_residual(model, record).plot().axes


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_is_its_module_too(verb):
    module = __import__(f"gsid.{verb}", fromlist=[verb])
    function = getattr(module, verb)
    assert getattr(gsid, verb) is module
    assert inspect.ismodule(module)
    assert inspect.signature(getattr(gsid, verb)) == inspect.signature(function)


def test_the_order_of_imports_does_not_matter():
    """The trap: importing the submodule sets the package's attribute of that name."""
    for lines in (
        "import gsid; f = gsid.compare",
        "import gsid; import gsid.compare; f = gsid.compare",
        "import gsid.compare as f",
        "import gsid.cli.main, gsid.report; f = gsid.compare",
    ):
        code = f"{lines}\ntry: f(None, [])\nexcept ValueError as e: assert 'no record' in str(e)\nelse: 1 / 0"
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0, lines


def test_nothing_is_loaded_before_it_is_used():
    code = (
        "import gsid, sys; assert not {'numpy', 'gsid._lib', 'gsid.comparison'} & set(sys.modules); dir(gsid)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_effects_of_ones_own_need_no_import_of_their_own():
    """A bug: gsid.effects.expression, as the documents have it, was there only once gsid.plant.model was loaded."""
    code = "import gsid; gsid.effects.expression('c*w', {'c': 1.0})"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_public_name_is_there():
    for name in gsid.__all__:
        assert getattr(gsid, name) is not None
        assert name in dir(gsid)
    with pytest.raises(AttributeError, match="no attribute 'compair'"):
        gsid.compair  # noqa: B018
