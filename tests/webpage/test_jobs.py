"""The commands of the page: how they begin, end and are stopped, and what is kept of them."""

import asyncio

from gsid.study.folder import Study
from gsid.webpage.server import Page

DEADLINE_S = 60


def study_with_a_record(tmp_path):
    study = Study(tmp_path / "st")
    (tmp_path / "a.csv").write_text("u,y\n" + "1,2\n2,1\n" * 50)
    study.add_file(tmp_path / "a.csv")
    return study


async def look(page):
    """One step, to its end."""
    await page.wish({"verb": "look", "records": ["records/a.csv"]})
    await asyncio.wait_for(page._running, DEADLINE_S)


def test_a_module_in_the_study_is_not_run(tmp_path):
    study = study_with_a_record(tmp_path)
    (study.folder / "click.py").write_text("open('owned', 'w').close()\n")
    asyncio.run(look(Page(study)))
    assert len(study.steps) == 1
    assert not (study.folder / "owned").exists()
