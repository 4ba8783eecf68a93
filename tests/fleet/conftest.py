"""A folder of small records, and jobs of the works in this folder."""

import itertools
from pathlib import Path

import pytest
from fleet_works import write_records

from gsid.fleet.forks import Forks, Setup
from gsid.fleet.unit import Job, Limits

NUMBERS = itertools.count()
HERE = str(Path(__file__).parent)


@pytest.fixture(scope="module")
def setup(tmp_path_factory):
    """Setup of a fleet whose works are those of this folder."""
    return Setup(
        str(tmp_path_factory.mktemp("fleet")),
        ("fleet_works",),
        Limits(seconds=20.0, memory_mb=8000.0),
        (HERE,),
    )


@pytest.fixture(scope="module")
def forks(setup):
    """One fork server for the tests of a file: it takes a second to start."""
    server = Forks(setup)
    yield server
    server.end()


@pytest.fixture
def job_of():
    """Job with the arguments of `fleet_works.work`, each with an address of its own."""

    def make(**arguments):
        i = next(NUMBERS)
        return Job(f"{i:064x}", "fleet_works:work", f"unit{i}", arguments=arguments, seed=i)

    return make


@pytest.fixture
def records(tmp_path):
    """Folder with three units, one record each."""
    return write_records(tmp_path / "records", 3)
