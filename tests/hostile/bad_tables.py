"""Bad tables of a torque, and a library that is none."""

from entries import TABLE_VERBS, Entry, read_by
from sound_files import ESCAPE, sound_files


def table_entries():
    good = sound_files()["curve.csv"].decode()
    texts = {
        "empty": "",
        "names alone": "w,torque\n",
        "one point": "w,torque\n0,0\n",
        "no torque": "w,force\n0,0\n1,1\n",
        "unknown variable": "velocity,torque\n0,0\n1,1\n2,2\n3,3\n",
        "ESC variable": f"{ESCAPE},torque\n0,0\n1,1\n2,2\n",
        "ESC cell": good.replace("1.5", ESCAPE),
        "ESC unit": f"# unit: {ESCAPE}\n{good}",
        "cut row": good[:-3],
        "two at one place": good + "2,3\n",
        "ragged": good + "3\n",
        "semicolons": good.replace(",", ";"),
        "huge": "w,torque\n" + "".join(f"{i},{i}\n" for i in range(200_000)),
        "near": "w,torque\n0,0\n5e-324,1\n1e-323,2\n1.5e-323,3\n",
        "far": "w,torque\n-1e308,0\n-1e307,1\n1e307,2\n1e308,3\n",
        "steep": "w,torque\n0,-1e308\n1,1e308\n2,-1e308\n3,1e308\n",
        "NUL": good.replace("1", "\0"),
        "only comments": "# a: b\n" * 100,
        "JSON": "{}",
    }
    for value in ("nan", "inf", "-inf", "1e400", "1e308", "1e30", "1e-320", "", "x", "1_0", "9" * 400):
        texts[f"torque {value[:9]}"] = good.replace("1.5\n2", f"{value}\n2")
        texts[f"place {value[:9]}"] = good.replace("\n1,", f"\n{value},")
    for name, text in texts.items():
        yield Entry("table", name, {"t.csv": text.encode()}, read_by(TABLE_VERBS, "t.csv"))
    yield Entry("table", "UTF-16", {"t.csv": good.encode("utf-16")}, read_by(TABLE_VERBS, "t.csv"))
    yield Entry("table", "bytes", {"t.csv": bytes(range(256)) * 10}, read_by(TABLE_VERBS, "t.csv"))
    yield Entry("library", "text", {"bad.so": b"no library"}, [["--library", "./bad.so:x", "effects"]])
