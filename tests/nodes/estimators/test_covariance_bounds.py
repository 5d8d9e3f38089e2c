import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nodes.estimators.covariance_bounds import loewner_minimum

SLACK = 1e-9


def random_covariance(seed: int, n: int) -> np.ndarray:
    factor = np.random.default_rng(seed).standard_normal((n, n))
    return factor @ factor.T


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 2), n=st.integers(1, 6))
def test_the_minimum_is_below_both(seed, n):
    X, Y = random_covariance(seed, n), random_covariance(seed + 1, n)
    least = loewner_minimum(X, Y)
    assert np.linalg.eigvalsh(X - least)[0] > -SLACK
    assert np.linalg.eigvalsh(Y - least)[0] > -SLACK


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 2), n=st.integers(1, 6))
def test_of_two_that_compare_it_is_the_smaller(seed, n):
    X = random_covariance(seed, n)
    Y = X + random_covariance(seed + 1, n) + 1e-3 * np.eye(n)
    assert loewner_minimum(X, Y) is X
    assert loewner_minimum(Y, X) is X


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6))
def test_of_a_matrix_with_itself_it_is_the_matrix(seed, n):
    X = random_covariance(seed, n)
    np.testing.assert_array_equal(loewner_minimum(X, X.copy()), X)


def test_of_two_that_do_not_compare_it_is_the_least_eigenvalue_of_both_on_the_diagonal():
    X, Y = np.diag([1.0, 5.0]), np.diag([4.0, 0.5])
    np.testing.assert_allclose(loewner_minimum(X, Y), 0.5 * np.eye(2), rtol=1e-14)


def test_a_difference_that_is_only_semidefinite_is_not_strictly_below():
    X, Y = np.diag([3.0, 2.0]), np.diag([1.0, 2.0])
    np.testing.assert_allclose(loewner_minimum(X, Y), np.eye(2), rtol=1e-14)
    np.testing.assert_array_equal(loewner_minimum(Y, X), Y)
