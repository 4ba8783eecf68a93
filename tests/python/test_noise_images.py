"""Images of a disturbance behind a sensor with a refresh rate: named as such, and nothing else is."""

import numpy as np
import pytest
from scipy.stats import binom

from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis
from gsid.spectrum.images import mark_images
from gsid.spectrum.noise import Noise, noise
from gsid.spectrum.tones import BY_CHANCE, Tone

FS_HZ, FAN_HZ, REFRESH_HZ, DURATION_S = 3000.0, 30.9, 400.02, 20
SEED = 3


@pytest.fixture(scope="module")
def at_rest():
    """Zero input of the simulated axis, whose free-running gyro has 400.02 Hz by the clock of the loop."""
    print("seed", SEED)
    axis = SimulatedAxis(
        seed=SEED, gyro_refresh_hz=REFRESH_HZ, gyro_free_running=1, noise_rms=0.05,
        fan_f_hz=FAN_HZ, fan_amplitude=0.03,
    )  # fmt: skip
    still = np.zeros(int(DURATION_S * FS_HZ))
    return noise(Record(still, axis.step(still)[1], FS_HZ, y_unit="deg/s"))


def test_the_images_of_a_fan_are_named(at_rest):
    """Bug: one fan was eight disturbances. Images are at multiples of the refresh rate +- the fan."""
    fan, *images = at_rest.tones
    assert abs(fan.f_hz - FAN_HZ) < 4 * fan.std_f_hz
    assert fan.image_of_hz == 0
    assert at_rest.refresh_hz == pytest.approx(REFRESH_HZ, rel=1e-5)
    assert len(images) >= 4
    for image in images:
        assert image.image_of_hz == fan.f_hz
        assert "(image of 30.90" in image.name
        distance = [
            abs(image.f_hz - abs(m * REFRESH_HZ + side * FAN_HZ - k * FS_HZ))
            for m in range(1, 9)
            for side in (-1, 1)
            for k in range(3)
        ]
        assert min(distance) < 5 * image.std_f_hz
    assert f"and {len(images)} of their images at the sensor's refresh rate of 400.02 Hz" in at_rest.sentence


def test_a_noise_model_keeps_the_images(at_rest, tmp_path):
    at_rest.save(tmp_path / "noise.json")
    kept = Noise.load(tmp_path / "noise.json")
    assert kept.sentence == at_rest.sentence
    assert [tone.name for tone in kept.tones] == [tone.name for tone in at_rest.tones]


def tone(f_hz, amplitude, std_f_hz=1e-3):
    return Tone(f_hz, std_f_hz, amplitude, 1e-4, 0.0, 1e-9)


def test_other_frequencies_are_images_no_more_often_than_by_chance():
    """Frequencies drawn from all of the band above half of the refresh rate."""
    rng = np.random.default_rng(20261123)
    n = 3000
    others = [tone(f_hz, 1e-3) for f_hz in rng.uniform(REFRESH_HZ / 2, FS_HZ / 2, n)]
    marked = mark_images([tone(FAN_HZ, 0.03), *others], REFRESH_HZ, FS_HZ, 1 / DURATION_S)
    count = sum(one.image_of_hz > 0 for one in marked)
    print("marked", count, "of", n)
    assert count <= binom.ppf(0.999, n, BY_CHANCE)


def test_what_is_no_image():
    """No refresh rate; an image larger than its source; a frequency that is not known well enough."""
    image_hz = REFRESH_HZ - FAN_HZ
    fan, image = tone(FAN_HZ, 0.03), tone(image_hz, 0.003)
    cases = (
        ([fan, image], 0.0),
        ([tone(FAN_HZ, 0.002), image], REFRESH_HZ),
        ([fan, tone(image_hz, 0.003, std_f_hz=1.0)], REFRESH_HZ),
    )
    for tones, refresh_hz in cases:
        assert mark_images(tones, refresh_hz, FS_HZ, 0.05) == tones
    assert mark_images([fan, image], REFRESH_HZ, FS_HZ, 0.05)[1].image_of_hz == FAN_HZ


def test_the_picture_names_disturbances_and_not_each_of_their_images(at_rest):
    """Their names lay on each other."""
    ax = at_rest.plot().axes[1]
    assert [text.get_text() for text in ax.texts] == [at_rest.tones[0].name]
    n_images = len(at_rest.tones) - 1
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend[0].startswith("periodic disturbances (1)")
    assert legend[1] == f"their images at the refresh rate of 400.02 Hz ({n_images})"
