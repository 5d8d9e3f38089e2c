"""How many packets there are and what they say, against theory over independent slots."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, norm, poisson

from bus.random_streams import random_stream
from channel.attacks.laws import Box, Copied, CountLaw, Near, Normal, ValueLaw, count_law
from channel.draws import SlotStreams

SLOTS = 4000


def slots(purpose):
    streams = SlotStreams(random_stream(5, 0, "l", purpose))
    return (streams.at(slot) for slot in range(SLOTS))


def test_a_plain_number_is_a_fixed_count():
    assert {count_law(3).draw(generator) for generator in slots("fixed")} == {3}


def test_a_poisson_count_has_the_law_of_poisson():
    """Chi-square over cells 0..5 and more; false-alarm rate 1e-6."""
    counts = np.array([CountLaw(poisson=2.0).draw(generator) for generator in slots("poisson")])
    seen = np.bincount(np.minimum(counts, 6), minlength=7)
    expected = np.append(poisson.pmf(range(6), 2.0), poisson.sf(5, 2.0)) * SLOTS
    assert chisquare(seen, expected).pvalue > 1e-6


def test_a_uniform_count_takes_both_ends_and_all_between_alike():
    """Chi-square over the cells 2..6; false-alarm rate 1e-6."""
    counts = np.array([CountLaw(uniform=[2, 6]).draw(generator) for generator in slots("uniform")])
    assert set(counts) == {2, 3, 4, 5, 6}
    assert chisquare(np.bincount(counts)[2:]).pvalue > 1e-6


def test_a_box_is_uniform_between_its_bounds_in_each_component():
    """Kolmogorov-Smirnov on two components; false-alarm rate 2e-6."""
    law = ValueLaw(box=Box(low=[-1.0, 5.0], high=[1.0, 6.0]))
    drawn = np.array([law.draw(generator, 1, None, ()) for generator in slots("box")])[:, 0]
    for column, low, width in zip(drawn.T, (-1.0, 5.0), (2.0, 1.0), strict=True):
        assert low <= column.min() <= column.max() <= low + width
        assert kstest((column - low) / width, "uniform").pvalue > 1e-6


def test_a_normal_law_has_its_mean_and_std():
    """Kolmogorov-Smirnov; false-alarm rate 1e-6."""
    law = ValueLaw(normal=Normal(mean=3.0, std=2.0, size=1))
    drawn = np.array([law.draw(generator, 1, None, ()) for generator in slots("normal")]).ravel()
    assert kstest(drawn, norm(3.0, 2.0).cdf).pvalue > 1e-6


def test_near_is_uniform_around_the_genuine_payload():
    """Kolmogorov-Smirnov; false-alarm rate 1e-6."""
    law = ValueLaw(near=Near(0.5))
    drawn = np.array([law.draw(generator, 1, np.array([7.0]), ()) for generator in slots("near")]).ravel()
    assert kstest(drawn - 6.5, "uniform").pvalue > 1e-6


def test_a_copy_is_any_of_the_older_payloads_with_equal_chances():
    """Chi-square over four of them; false-alarm rate 1e-6."""
    law = ValueLaw(copied=Copied())
    older = [np.array([float(number)]) for number in range(4)]
    drawn = [int(law.draw(generator, 1, None, older)[0][0]) for generator in slots("copied")]
    assert chisquare(np.bincount(drawn, minlength=4)).pvalue > 1e-6


@pytest.mark.parametrize("law", [Box(-1.0, 1.0), Normal(1.0), Near(1.0), Copied()])
def test_nothing_is_drawn_while_the_size_of_a_payload_is_unknown(law):
    generator = random_stream(1, 0, "l", "none")
    assert ValueLaw(**{type(law).__name__.lower(): law}).draw(generator, 2, None, ()) is None


def test_a_law_of_another_size_than_the_genuine_payload_must_say_so():
    generator = random_stream(1, 0, "l", "size")
    with pytest.raises(ValueError, match="a law of 2 values for a payload of 3"):
        Box([0.0, 0.0], 1.0).draw(generator, 1, np.zeros(3), ())
    (malformed,) = Box(0.0, 1.0, size=2).draw(generator, 1, np.zeros(3), ())
    assert malformed.size == 2


@pytest.mark.parametrize(
    "make",
    [
        lambda: ValueLaw(),
        lambda: ValueLaw(near=Near(1.0), copied=Copied()),
        lambda: CountLaw(),
        lambda: CountLaw(fixed=1, poisson=1.0),
        lambda: CountLaw(uniform=[3, 2]),
        lambda: CountLaw(uniform=[3]),
        lambda: Box(1.0, 0.0),
        lambda: Box([1.0], [2.0, 3.0]),
        lambda: Normal(-1.0),
        lambda: Normal([1.0, 1.0], size=3),
        lambda: Near(-1.0),
    ],
)
def test_what_is_no_law_is_refused(make):
    with pytest.raises(ValueError, match=r"exactly one|must|exchange"):
        make()
