"""Bad JSON: model files of every kind, torque laws in them, and meta.json beside a record."""

import itertools
import json

from entries import BESIDE_VERBS, MATRIX_VERBS, PLANT_VERBS, RATIONAL_VERBS, Entry, read_by
from sound_files import (
    ESCAPE,
    FS_HZ,
    U,
    Y,
    catalogue_plant,
    csv,
    matrix,
    pieces,
    plant,
    rational,
    small_plant,
)

BAD_JSON = [
    "null",
    "true",
    "-1",
    "0",
    "1e400",
    "-1e400",
    "NaN",
    "1e30",
    "1e308",
    "1e-320",
    "1" + "0" * 400,
    '""',
    '"NaN"',
    json.dumps(ESCAPE + "\nfs_hz: 7"),
    '"\\ud800"',
    "[]",
    "{}",
    "[[]]",
    "[null]",
    "[1, [2, 3]]",
    '[1, "x"]',
    '{"value": null}',
    "[" * 50 + "]" * 50,
    json.dumps("x" * 100_000),
    "[" + "1," * 50_000 + "1]",
]
PLACE = "@@here@@"


def paths(data, prefix=()):
    """Keys and indices of every value of a document; of a list its first and last element."""
    if isinstance(data, dict):
        items = list(data.items())
    elif isinstance(data, list):
        items = [(i, data[i]) for i in sorted({0, len(data) - 1})] if data else []
    else:
        items = []
    for key, value in items:
        yield (*prefix, key)
        yield from paths(value, (*prefix, key))


def replaced(data, path, raw):
    """The document's text with another value at a place: `raw` is text, since JSON of Python has no 1e400."""
    document = json.loads(json.dumps(data))
    node = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = PLACE
    return json.dumps(document).replace(json.dumps(PLACE), raw)


def without(data, path):
    document = json.loads(json.dumps(data))
    node = document
    for key in path[:-1]:
        node = node[key]
    del node[path[-1]]
    return json.dumps(document)


def renamed(data, path, name):
    document = json.loads(json.dumps(data))
    node = document
    for key in path[:-1]:
        node = node[key]
    node[name] = node.pop(path[-1])
    return json.dumps(document)


def model_entries(rng):
    documents = {
        "plant": (plant(), PLANT_VERBS, 5),
        "catalogue": (catalogue_plant(), PLANT_VERBS, 3),
        "rational": (rational(), RATIONAL_VERBS, 5),
        "rational z": (rational("z"), RATIONAL_VERBS, 2),
        "matrix": (matrix(), MATRIX_VERBS, 3),
        "pieces": (pieces(), RATIONAL_VERBS, 1),
    }
    for kind, (data, verbs, most) in documents.items():
        turn = itertools.count()

        def entry(name, text, kind=kind, verbs=verbs, turn=turn):
            i = next(turn)
            content = text if isinstance(text, bytes) else text.encode()
            return Entry(
                kind,
                name,
                {f"{kind[0]}{kind[-1]}{i}.json": content},
                read_by(verbs, f"{kind[0]}{kind[-1]}{i}.json", turn=i),
            )

        for path in paths(data):
            chosen = [BAD_JSON[i] for i in rng.permutation(len(BAD_JSON))[:most]]
            for raw in chosen:
                yield entry(f"{path} = {raw[:40]}", replaced(data, path, raw))
            if isinstance(path[-1], str) and rng.random() < 0.5:
                yield entry(f"without {path}", without(data, path))
                yield entry(f"{path} by another name", renamed(data, path, ESCAPE))
        text = json.dumps(data)
        yield entry("keys in reverse", json.dumps(dict(reversed(data.items()))))
        yield entry("cut", text[: len(text) // 2])
        yield entry("twice", text + text)
        yield entry("byte order mark", "\ufeff" + text)
        yield entry("UTF-16", text.encode("utf-16"))
        yield entry("NUL", text.replace(" ", "\0").encode())
    for text in (
        "",
        "null",
        "[]",
        "7",
        "[" * 100_000,
        '{"a":' * 100_000,
        '"x"',
        "{}",
        '{"gsid_model": 1}',
        "9" * 5000,
    ):
        yield Entry("model", text[:30], {"m.json": text.encode()}, read_by(PLANT_VERBS, "m.json"))
    yield from large_models()
    yield from law_entries()


def large_models():
    """Sound but for their size."""

    def entry(name, data, verbs=PLANT_VERBS):
        return Entry("size", name, {"large.json": json.dumps(data).encode()}, read_by(verbs, "large.json"))

    for n in (100, 3000, 70_000):
        data = small_plant()
        data["effects"] += [{"effect": "viscous_friction", "params": {"rate": 0.1}}] * n
        yield entry(f"{n} effects", data)
    data = small_plant()
    data["history"] = [{"step": "x"}] * 200_000
    yield entry("200000 steps", data)
    data = small_plant()
    data["effects"][0]["params"] |= {f"p{i}": 1.0 for i in range(100_000)}
    yield entry("100000 parameters", data)
    data = rational()
    data["rational"]["num"] = [1.0] * 100_000
    yield entry("order 100000", data, RATIONAL_VERBS)
    data = matrix()
    data["common_denominator"]["sections"] = [1.0] * 5000
    data["common_denominator"]["num"] = [[[1.0] * 5000], [[1.0] * 5000]]
    data["common_denominator"]["covariance"] = None
    yield entry("5000 poles", data, MATRIX_VERBS)
    data = pieces()
    data["pieces"] = data["pieces"] * 3000
    data["breaks_hz"] = list(range(5999))
    yield entry("6000 pieces", data, RATIONAL_VERBS)


WRONG_LAWS = [
    "",
    "c*",
    "c*tanh(w/0)",
    "w^w^w^w",
    "exp(exp(w))",
    "1/0",
    "0/0*w",
    "log(-1)*c",
    "__import__('os')",
    "c.real",
    "w" * 600,
    "(" * 240 + "w" + ")" * 240,
    "-" * 400 + "w",
    "w+" * 249 + "w",
    "c*1e400",
    "c*" + "9" * 400,
    ESCAPE,
    "lambda: w",
    "c if w else 1",
    "sign(w)",
    "t",
    "c*w^99",
    "1e308*w*1e308",
    "sqrt(w)",
    "w^0.5",
    "abs(w)^-1",
    "c*1j",
    "c*True",
    "'c'",
    "f'{c}'",
    "w\0",
    "c*w # x",
]


def law_entries():
    """Values that the catalogue allows, or that look so, and torque laws."""

    def entry(name, effects, **more):
        data = small_plant() | more
        data["effects"] = data["effects"] + effects
        return Entry("law", name, {"law.json": json.dumps(data).encode()}, read_by(PLANT_VERBS, "law.json"))

    for text in WRONG_LAWS:
        yield entry(text[:40], [{"effect": "expression", "torque": text, "params": {"c": 1.0}}])
    for effect, params in (
        ("hard_stop", {"angle_deg": 1e-9, "stiffness": 1e9}),
        ("coulomb_friction", {"level": 1e9}),
        ("cubic_spring", {"stiffness": 1e9}),
        ("transport_delay", {"delay_s": 1e3}),
        ("transport_delay", {"delay_s": 1e-300}),
        ("flexible_mode", {"f_hz": 1e9, "zeta": 1e-9, "residue": 1e9}),
        ("flexible_mode", {"f_hz": 1e-9, "zeta": 0.0, "residue": 1.0}),
        ("sensor_sample_hold", {"rate_hz": 1e-9}),
        ("sensor_sample_hold", {"rate_hz": 1e9}),
        ("motor_lag", {"time_constant_s": 1e-300}),
        ("motor_lag", {"time_constant_s": 1e9}),
        ("motor_cogging", {"level": 1e6, "cycles_per_rev": 1e6, "phase_rad": 1e6}),
        ("periodic_disturbance", {"f_hz": 1e9, "amplitude": 1e9, "phase": 1e9}),
        ("drive_quantization", {"step": 1e-300}),
        ("drive_quantization", {"step": 1e9}),
        ("gear_backlash", {"gap_deg": 1e9, "stiffness": 1e9, "inertia_ratio": 1e9}),
        ("position_velocity_loop", {"kp": 1e9, "kv": 1e9, "limit": 1e-9}),
    ):
        yield entry(f"{effect} {params}", [{"effect": effect, "params": params}])
    for fs_hz in (1e-300, 1e-3, 1e9, 1e300):
        yield entry(f"fs_hz {fs_hz:g}", [], fs_hz=fs_hz)


def beside_entries():
    good = {
        "fs_hz": FS_HZ,
        "period_samples": 60,
        "channels": [{"name": "u", "unit": "A"}],
        "files": {"r.csv": {}},
    }
    texts = [replaced(good, path, raw) for path in paths(good) for raw in BAD_JSON]
    texts += [
        "[" * 100_000,
        '{"files": ' * 5000,
        "null",
        '"r.csv"',
        "[]",
        '{"files": "r.csv"}',
        '{"files": ["r.csv"]}',
    ]
    for i, text in enumerate(texts):
        if i % 4 and i < len(texts) - 7:
            continue
        files = {
            f"beside{i}/meta.json": text.encode(),
            f"beside{i}/r.csv": csv(keys={}, columns={"u": U, "y": Y}),
        }
        verbs = read_by(BESIDE_VERBS, f"beside{i}/r.csv", turn=i)
        yield Entry("meta.json", text[:60], files, verbs)
