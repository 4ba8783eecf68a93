"""gsid look, and its picture of the record."""

import json
from dataclasses import replace

import numpy as np
import pytest
from known_system import FS_HZ, LINES, N_PERIOD, N_PERIODS
from scipy.integrate import cumulative_trapezoid

from gsid.base.extremes import MOST_POINTS, extremes
from gsid.records.files import read_record, write_record

F_HZ = LINES * FS_HZ / N_PERIOD


def looked(gsid, *arguments):
    result = gsid("look", *arguments, "--json")
    assert result.code == 0
    return json.loads(result.out)


def test_the_facts_of_a_record(gsid, rec_csv):
    (facts,) = looked(gsid, rec_csv)["records"]
    assert facts["samples"] == N_PERIOD * N_PERIODS
    assert facts["period_samples"] == N_PERIOD
    assert facts["excited_lines"] == len(LINES)
    assert facts["lost_samples"] == 0
    assert (facts["u_unit"], facts["y_unit"], facts["hold"]) == ("A", "deg/s", "not stated")


def test_the_band_is_two_numbers_and_other_columns_are_a_list(gsid, record, tmp_path):
    record.columns = {"temperature": np.zeros(len(record.u)), "a, b": np.ones(len(record.u))}
    write_record(tmp_path / "rec.h5", record)
    (facts,) = looked(gsid, "rec.h5")["records"]
    assert facts["band_hz"] == pytest.approx([F_HZ[0], F_HZ[-1]])
    assert sorted(facts["other_columns"]) == ["a, b", "temperature"]


def test_the_sentence_and_the_table_have_the_band_in_words(gsid, rec_csv):
    words = f"{F_HZ[0]:.4g} to {F_HZ[-1]:.4g}"
    (sentence,) = looked(gsid, rec_csv)["sentences"]
    assert sentence.endswith(f"{len(LINES)} excited lines from {words} Hz.")
    rows = [line.split(maxsplit=1) for line in gsid("look", rec_csv).out.splitlines()]
    assert ["band_hz", words] in [[part.strip() for part in row] for row in rows]


def test_a_record_without_a_period_is_shown(gsid, record, tmp_path):
    record.u = np.random.default_rng(31).standard_normal(len(record.u))
    record.period_samples = None
    write_record(tmp_path / "rec.csv", record)
    result = gsid("look", "rec.csv", "--json", "--plot", "rec.png")
    assert result.code == 0
    values = json.loads(result.out)
    assert values["records"][0]["band_hz"] is None
    assert values["sentences"][0].endswith("no period was found.")
    assert "note: " in result.err
    assert (tmp_path / "rec.png").stat().st_size > 0


def test_lost_samples_are_counted(gsid, record, tmp_path):
    record.valid = np.ones(len(record.u), bool)
    record.valid[[3, 700]] = False
    write_record(tmp_path / "rec.h5", record)
    assert looked(gsid, "rec.h5")["records"][0]["lost_samples"] == 2


def test_several_records_have_a_column_each(gsid, record, tmp_path):
    for name in ("a.csv", "b.csv"):
        write_record(tmp_path / name, record)
    assert gsid("look", "a.csv", "b.csv").out.splitlines()[0].split() == ["a.csv", "b.csv"]
    assert len(looked(gsid, "a.csv", "b.csv")["records"]) == 2


# ---------------------------------------------------------------- points of a long curve

LONG = [MOST_POINTS + 1, 10 * MOST_POINTS, 10 * MOST_POINTS + 7, 1_000_003]


@pytest.mark.parametrize("n", [1, 7, MOST_POINTS])
def test_a_short_signal_is_drawn_as_it_is(n):
    place, shown = extremes(np.arange(n) + 5.0)
    np.testing.assert_array_equal(place, np.arange(n))
    np.testing.assert_array_equal(shown, np.arange(n) + 5.0)


@pytest.mark.parametrize("n", LONG)
@pytest.mark.parametrize("where", [0.0, 0.37, 1.0])
@pytest.mark.parametrize("spike", [-9.0, 9.0])
def test_a_spike_in_a_long_record_is_drawn(n, where, spike):
    values = 5 + np.sin(np.arange(n))
    at = round(where * (n - 1))
    values[at] += spike
    place, shown = extremes(values)
    assert shown[place == at] == values[at]
    assert len(place) <= MOST_POINTS + 100


@pytest.mark.parametrize("n", LONG)
def test_points_are_samples_in_order_to_the_end(n):
    values = np.random.default_rng(32).standard_normal(n)
    place, shown = extremes(values)
    assert np.all(np.diff(place) > 0)
    assert place[-1] >= n - 2 * (3 * n // MOST_POINTS + 1)
    np.testing.assert_array_equal(shown, values[place])
    assert (shown.min(), shown.max()) == (values.min(), values.max())


@pytest.mark.parametrize("length", [1, 13, 50_000])
@pytest.mark.parametrize("offset", [-5.0, 0.0, 5.0])
def test_a_gap_is_drawn_and_hides_no_spike_beside_it(length, offset):
    values = offset + np.sin(np.arange(400_000.0))
    begin = 123_456
    values[begin : begin + length] = np.nan
    values[begin - 1], values[begin + length] = offset - 3, offset + 3
    place, shown = extremes(values)
    in_gap = (place >= begin) & (place < begin + length)
    assert in_gap.any()
    assert np.isnan(shown[in_gap]).all()
    assert not np.isnan(shown[~in_gap]).any()
    assert (np.nanmin(shown), np.nanmax(shown)) == (offset - 3, offset + 3)


def test_a_signal_without_samples_is_all_gap():
    assert np.isnan(extremes(np.full(100_000, np.nan))[1]).all()


def test_drift_and_spikes_are_in_the_sentence(gsid, record):
    record.y = record.y + 5.0 * np.arange(len(record.y)) / N_PERIOD
    record.y[2 * N_PERIOD + 7] += 300.0
    write_record("rec.csv", record)
    values = looked(gsid, "rec.csv")
    (facts,) = values["records"]
    assert facts["drifts"]
    assert facts["spikes_s"] == pytest.approx([(2 * N_PERIOD + 7) / FS_HZ])
    assert "The mean output drifts by " in values["sentences"][0]
    assert "1 spike in the output, at " in values["sentences"][0]


def test_the_position_is_compared_with_limits_on_both_sides_or_one(gsid, rec_csv):
    record = read_record(rec_csv)
    y = record.y - record.y.mean()  # whole periods
    angle = np.concatenate([[0], cumulative_trapezoid(y)]) / record.fs_hz
    values = looked(gsid, rec_csv)["records"][0]
    assert values["position"] == pytest.approx([angle.min(), angle.max()], rel=1e-9)
    assert values["position_unit"] == "deg"
    assert "within_travel" not in values
    for limits, code in (
        ("1", 0),
        (f"{0.9 * angle.max()}", 1),
        (f":{1.1 * angle.max()}", 0),
        (f":{0.9 * angle.max()}", 1),
        (f"{0.9 * angle.min()}:50", 1),
        (f"{1.1 * angle.min()}:", 0),
    ):
        result = gsid("look", rec_csv, "--limit-travel-deg", limits, "--json")
        assert result.code == code, (limits, result.err)
        answer = json.loads(result.out)
        assert answer["records"][0]["within_travel"] == (code == 0)
        assert answer["sentences"][0].endswith(f"{'within' if code == 0 else 'beyond'} its limits.")
    for limits in ("0", "1:2", "a", ":", "-1"):
        assert gsid("look", rec_csv, "--limit-travel-deg", limits).code == 2
    write_record("volts.csv", replace(record, y_unit="V"))
    refused = gsid("look", "volts.csv", "--limit-travel-deg", "2")
    assert (refused.code, "the position is not known" in refused.err) == (3, True)
    assert looked(gsid, "volts.csv")["records"][0]["position"] is None


def test_bug_a_limit_in_degrees_was_compared_with_a_position_in_radians(gsid, rec_csv):
    low, high = looked(gsid, rec_csv)["records"][0]["position"]
    most = max(-low, high)
    y = read_record(rec_csv).y
    for unit, factor in (("rad/s", np.pi / 180), ("deg/s", 1.0)):
        write_record("other.csv", replace(read_record(rec_csv), y=factor * y, y_unit=unit))
        assert gsid("look", "other.csv", "--limit-travel-deg", f"{0.9 * most}", "--plot", "l.png").code == 1
        assert gsid("look", "other.csv", "--limit-travel-deg", f"{1.1 * most}").code == 0
    write_record("other.csv", replace(read_record(rec_csv), y_unit="m/s"))
    refused = gsid("look", "other.csv", "--limit-travel-deg", "2")
    assert (refused.code, "the position is not known" in refused.err) == (3, True)


def test_a_clipped_output_has_its_ends_and_their_share(gsid, record, tmp_path):
    low = float(np.quantile(record.y, 0.1))
    record.y = np.maximum(record.y, low)
    write_record(tmp_path / "rec.csv", record)
    (facts,) = looked(gsid, "rec.csv")["records"]
    (end,) = facts["clipped"]
    assert end["value"] == pytest.approx(low)
    assert end["share"] == pytest.approx(0.1, abs=0.01)
    (sentence,) = looked(gsid, "rec.csv")["sentences"]
    assert (
        f"The output stays at an end of its range, {low:.4g} in {end['share']:.2%} of the samples."
        in sentence
    )
    assert f"{low:.4g} in {end['share']:.2%}" in gsid("look", "rec.csv").out


def test_an_output_within_its_range_has_no_clipped_end(gsid, rec_csv):
    assert looked(gsid, rec_csv)["records"][0]["clipped"] == []
