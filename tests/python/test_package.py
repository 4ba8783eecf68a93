"""The package's own names: plain functions and classes, loaded when they are first used."""

import ast
import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plants import axis_record, plant

import gsid

SEED = 20260411
VERBS = (
    *("add", "compare", "diagnose", "distortion", "fit", "frf", "noise", "spectra", "start"),
    "torque_residual",
)


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


def test_a_public_function_is_a_plain_function():
    """A bug: gsid.frf, gsid.fit, ... were modules that could be called, and no editor saw their types."""
    for verb in VERBS:
        assert inspect.isfunction(getattr(gsid, verb))
        assert getattr(gsid, verb).__name__ == verb


def test_no_module_bears_the_name_of_a_public_function():
    names = {module.name for module in pkgutil.iter_modules(gsid.__path__)}
    assert names & set(gsid.__all__) == {"effects"}


def test_no_package_hands_on_a_function_under_the_name_of_its_module():
    """The trap: importing the submodule would put it in the place of the function."""
    for package in pkgutil.walk_packages(gsid.__path__, "gsid."):
        if package.ispkg:
            module = importlib.import_module(package.name)
            names = {name for _, name, _ in pkgutil.iter_modules(module.__path__)}
            assert not [name for name in names if inspect.isroutine(vars(module).get(name))], package.name


def test_type_checkers_see_the_names_that_are_loaded():
    """`__init__` lists the public names twice: for type checkers, and for loading when first used."""
    tree = ast.parse(Path(gsid.__file__).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")
    seen = {
        alias.asname: node.module.removeprefix("gsid.")
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module != "gsid"
        for alias in node.names
    }
    assert seen == gsid._HOME


def test_the_type_of_every_public_function_is_checked():
    """`make lint` checks tests/build/typed_api.py with mypy."""
    checked = (Path(__file__).parents[1] / "build/typed_api.py").read_text()
    for name in gsid.__all__:
        if inspect.isfunction(getattr(gsid, name)) and not name.startswith("write_"):  # they return nothing
            assert f"gsid.{name}(" in checked, name


def test_nothing_is_loaded_before_it_is_used():
    code = (
        "import gsid, sys; assert not {'numpy', 'gsid._lib', 'gsid.comparison'} & set(sys.modules); dir(gsid)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_effects_of_ones_own_need_no_import_of_their_own():
    """A bug: gsid.effects.expression, as documented, was there only once the plant's module was loaded."""
    code = "import gsid; gsid.effects.expression('c*w', {'c': 1.0})"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_public_name_is_there():
    for name in gsid.__all__:
        assert getattr(gsid, name) is not None
        assert name in dir(gsid)
    with pytest.raises(AttributeError, match="no attribute 'compair'"):
        gsid.compair  # noqa: B018
