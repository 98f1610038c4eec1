"""Time to contact on rendered approaches: square, slanted, sideways, turning, with and without a camera."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

import rsflow
from rsflow import Camera, ContactStatus, DTypeError, OptionError, ShapeError, TimeToContact, synthetic

LENS = Camera(150.0, 150.0, 79.5, 59.5, width=160, height=120, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))


def rocking(t_s):
    return 0.3 * np.array([np.sin(5 * t_s), np.cos(4 * t_s), np.sin(3 * t_s)])


MOTIONS = {
    "square": {},
    "sideways": {"across": (0.3, -0.2)},
    "slanted": {"tilt_rad": (0.4, 0.2)},
    "slanted and sideways": {"tilt_rad": (0.35, 0.2), "across": (0.2, 0.1)},
    "turning": {"rate_rad_s": rocking},
}


@functools.cache
def approach(begin_s, end_s, motion="square", *, camera=None):
    """Render frames from `begin_s` to `end_s` before contact, at 0.5 m/s."""
    options = dict(MOTIONS[motion])
    across = options.pop("across", (0.0, 0.0))
    return synthetic.flight(
        camera,
        frames=round((begin_s - end_s) * 30) + 1,
        height_m=0.5 * begin_s,
        velocity_m_s=(*across, 0.5),
        texture_scale_m=0.5 * begin_s / 500,
        seed=7,
        **options,
    )


def errors(clip, estimator, *, rates=False, skip=8):
    """Relative errors, errors in deviations, and whether intervals hold the truth, once the baseline has grown."""
    found = []
    for k, frame in enumerate(clip):
        contact = estimator.update(frame.image, frame.t_s, rate_rad_s=clip.rate_rad_s[k] if rates and k else None)
        if k < skip:
            continue
        speed = (clip.height_m[k - 1] - clip.height_m[k]) * 30
        truth = clip.height_m[k] / speed
        assert contact.status is ContactStatus.OK
        off = contact.time_to_contact_s - truth
        found.append((off / truth, off / contact.std_s, contact.low_s <= truth <= contact.high_s))
    return np.array(found).T


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize(("begin_s", "end_s"), [(5.4, 4.8), (2.4, 1.9), (1.1, 0.5)])
def test_at_most_five_percent_off_from_five_seconds_to_half_a_second(begin_s, end_s, motion):
    clip = approach(begin_s, end_s, motion)
    relative, deviations, inside = errors(clip, TimeToContact(clip.camera))
    assert np.abs(relative).max() < 0.05
    assert np.sqrt(np.mean(relative**2)) < 0.015
    assert np.sqrt(np.mean(deviations**2)) < 1.6
    assert inside.mean() > 0.8


@pytest.mark.parametrize("motion", MOTIONS)
def test_without_a_camera(motion):
    relative, _, inside = errors(approach(2.4, 1.9, motion), TimeToContact())
    assert np.abs(relative).max() < 0.05
    assert inside.all()


def test_a_lens_that_distorts():
    clip = approach(2.4, 1.9, "sideways", camera=LENS)
    assert np.abs(errors(clip, TimeToContact(LENS))[0]).max() < 0.02
    assert np.abs(errors(clip, TimeToContact())[0]).max() < 0.05


def test_rates_that_are_given():
    relative, _, inside = errors(approach(2.4, 1.9, "turning"), TimeToContact(approach(2.4, 1.9).camera), rates=True)
    assert np.abs(relative).max() < 0.02
    assert inside.all()


def test_two_pictures_alone():
    clip = approach(1.1, 0.5)
    contact = rsflow.time_to_contact(clip.images[0], clip.images[3], 0.1, camera=clip.camera)
    assert contact.time_to_contact_s == pytest.approx(clip.height_m[3] * 2, rel=0.03)
    assert contact.baseline_s == pytest.approx(0.1)
    assert contact.low_s < contact.time_to_contact_s < contact.high_s


def test_divergence_of_a_square_approach_is_twice_the_closing_rate():
    clip = approach(2.4, 1.9)
    contact = rsflow.time_to_contact(clip.images[0], clip.images[1], 1 / 30)
    assert contact.divergence_1_s == pytest.approx(2 * contact.closing_1_s, rel=0.05)
    assert contact.closing_1_s == pytest.approx(1 / contact.time_to_contact_s)


@pytest.mark.parametrize(
    ("velocity", "status"),
    [
        ((0.0, 0.0, -0.3), ContactStatus.RECEDING),
        ((0.2, 0.1, 0.0), ContactStatus.NOT_APPROACHING),
        ((0.0, 0.0, 0.0), ContactStatus.NOT_APPROACHING),
    ],
    ids=["away", "along", "still"],
)
def test_without_an_approach_the_time_is_infinite(velocity, status):
    clip = synthetic.flight(frames=16, height_m=1.0, velocity_m_s=velocity, seed=2)
    estimator = TimeToContact(clip.camera)
    contact = [estimator.update(frame.image, frame.t_s) for frame in clip][-1]
    assert contact.status is status
    assert not contact.valid
    assert contact.time_to_contact_s == math.inf
    assert contact.std_s == math.inf
    assert contact.low_s > 10.0


def test_a_turn_alone_is_no_approach():
    clip = synthetic.flight(frames=20, height_m=1.0, velocity_m_s=(0, 0, 0), rate_rad_s=rocking, seed=3)
    estimator = TimeToContact(clip.camera)
    found = [estimator.update(frame.image, frame.t_s) for frame in clip][1:]
    assert {contact.status for contact in found} == {ContactStatus.NOT_APPROACHING}


def test_what_cannot_be_measured():
    clip = approach(1.1, 0.5)
    estimator = TimeToContact()
    assert estimator.update(clip.images[0], 0.0).status is ContactStatus.FIRST_FRAME
    assert estimator.update(clip.images[1], 0.0).status is ContactStatus.TIME_NOT_INCREASING
    assert estimator.update(clip.images[0], 0.1).status is ContactStatus.REPEATED_FRAME
    noise = np.random.default_rng(1).integers(0, 255, clip.images[0].shape).astype(np.uint8)
    blank = np.full(clip.images[0].shape, 90, np.uint8)
    for image in (noise, blank):
        contact = estimator.update(image, estimator._frames[-1][1] + 0.1)
        assert contact.status in (ContactStatus.TOO_FEW_POINTS, ContactStatus.INCONSISTENT)
        assert math.isnan(contact.time_to_contact_s)
        assert contact.std_s == math.inf
    estimator.reset()
    assert estimator.update(clip.images[0], 0.0).status is ContactStatus.FIRST_FRAME


def test_a_mask_leaves_out_what_does_not_belong_to_the_plane():
    clip = approach(2.4, 1.9)
    images = clip.images.copy()
    images[:, 90:] = images[0, 90:]
    mask = np.ones(images[0].shape, np.bool_)
    mask[88:] = False
    estimator = TimeToContact(clip.camera, mask=mask)
    found = [estimator.update(image, t_s) for image, t_s in zip(images, clip.t_s, strict=True)]
    assert found[-1].time_to_contact_s == pytest.approx(clip.height_m[-1] * 2, rel=0.03)


def test_misuse_raises():
    clip = approach(1.1, 0.5)
    with pytest.raises(OptionError, match="dt_s: got 0"):
        rsflow.time_to_contact(clip.images[0], clip.images[1], 0)
    with pytest.raises(ShapeError, match="expected those of the camera, 160 x 120"):
        rsflow.time_to_contact(clip.images[0], clip.images[1], 0.1, camera=LENS)
    with pytest.raises(ShapeError):
        rsflow.time_to_contact(clip.images[0], clip.images[1][:-1], 0.1)
    with pytest.raises(DTypeError):
        rsflow.time_to_contact(clip.images[0], clip.images[1].astype(np.float32), 0.1)
