"""The page of effects is made from the descriptors, and is current."""

import re
import sys

from gsid.effects.types import catalogue

PAGE = "docs/reference/effects.md"


def test_the_page_of_effects_is_up_to_date(run, root):
    made = run(sys.executable, root / "tools/make_effects_page")
    assert made.returncode == 0, made.stderr
    assert (root / PAGE).read_text(encoding="utf-8") == made.stdout, "call: make effects-page"


def test_the_page_has_every_effect_and_parameter_once(root):
    page = (root / PAGE).read_text(encoding="utf-8")
    assert re.findall(r"^### `(\w+)`", page, re.M) == list(catalogue())
    for part in re.split(r"^### ", page, flags=re.M)[1:]:
        effect = catalogue()[re.match(r"`(\w+)`", part)[1]]
        assert re.findall(r"^\| `(\w+)` \|", part, re.M) == list(effect.names)
        assert effect.sentence in part
