"""Comparisons of independent runs."""
import statistics

import numpy as np


def z_of_sum(terms):
    """How far sum_i factor_i * mean_i is from 0, as a standard normal variable.

    Welch's t-test with Satterthwaite's degrees of freedom; t to z after D. L. Wallace, "Bounds on
    normal approximations to Student's and the chi-square distributions", 1959."""
    total = sum(factor * values.mean(axis=0) for factor, values in terms)
    parts = [(factor ** 2 * values.var(axis=0, ddof=1) / len(values), len(values) - 1)
             for factor, values in terms]
    variance = sum(v for v, _ in parts)
    freedom = variance ** 2 / sum(v ** 2 / n for v, n in parts)
    t = total / np.sqrt(variance)
    return (np.sign(t) * (8 * freedom + 1) / (8 * freedom + 3)
            * np.sqrt(freedom * np.log1p(t ** 2 / freedom)))


def z_of_difference(a, b):
    """The same of the difference of two means."""
    return z_of_sum([(1, a), (-1, b)])


def largest_by_chance(comparisons, family_wise):
    """|z| that any of so many exceeds with this probability: Sidak's correction."""
    each = 1 - (1 - family_wise) ** (1 / comparisons)
    return statistics.NormalDist().inv_cdf(1 - each / 2)
