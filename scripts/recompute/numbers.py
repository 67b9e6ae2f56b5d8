"""The statistics of docs/metrics.md, written from their definitions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

CONFIDENCE = 0.95
RESAMPLES = 2000
FEW = 30
LEAST_STUDENTISED = 4
FARTHEST = 3.0
MASK = (1 << 64) - 1

Bounds = tuple[float, float] | None


def mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def deviation(values: Sequence[float], without: int = 0) -> float:
    """The standard deviation; that of a sample `without=1`."""
    middle = mean(values)
    return math.sqrt(sum((value - middle) ** 2 for value in values) / (len(values) - without))


def median(values: Sequence[float]) -> float:
    ordered = sorted(values)
    return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


def interquartile_mean(values: Sequence[float]) -> float:
    cut = len(values) // 4
    return mean(sorted(values)[cut : len(values) - cut])


def quantile(ordered: Sequence[float], share: float) -> float:
    """Hyndman & Fan's type 7."""
    place = share * (len(ordered) - 1)
    below, above = ordered[math.floor(place)], ordered[math.ceil(place)]
    part = place - math.floor(place)
    return below if part == 0 or below == above else below + part * (above - below)


def slope(points: Sequence[tuple[float, float]]) -> float:
    """Of y over x, by least squares."""
    middle = mean([x for x, _ in points])
    return sum((x - middle) * y for x, y in points) / sum((x - middle) ** 2 for x, _ in points)


def _ranks(values: Sequence[float]) -> list[float]:
    """Ranks from 1, ties sharing their mean."""
    ordered = sorted(values)
    first = {value: place for place, value in reversed(list(enumerate(ordered, 1)))}
    return [first[value] + (ordered.count(value) - 1) / 2 for value in values]


def rank_correlation(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Spearman's; none where either is the same throughout."""
    a, b = _ranks(one), _ranks(other)
    spread = deviation(a) * deviation(b)
    if spread == 0:
        return None
    return mean([x * y for x, y in zip(a, b)]) / spread - mean(a) * mean(b) / spread


# ChaCha with 8 rounds (Bernstein 2008). Its key comes from a PCG generator that is seeded with 0.


def _key(seed: int) -> list[int]:
    words = []
    for _ in range(8):
        seed = (seed * 0x5851F42D4C957F2D + 0xA17654E46FBE17F3) & MASK
        shifted = (((seed >> 18) ^ seed) >> 27) & 0xFFFFFFFF
        turn = seed >> 59
        words.append((shifted >> turn | shifted << (32 - turn)) & 0xFFFFFFFF)
    return words


def _block(key: list[int], counter: int) -> list[int]:
    start = [0x61707865, 0x3320646E, 0x79622D32, 0x6B206574, *key, counter & 0xFFFFFFFF, counter >> 32, 0, 0]
    x = list(start)
    for _ in range(4):
        for a, b, c, d in (
            (0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
            (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14),
        ):  # fmt: skip
            for first, second, third, left in ((a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)):
                x[first] = (x[first] + x[second]) & 0xFFFFFFFF
                mixed = x[third] ^ x[first]
                x[third] = (mixed << left | mixed >> (32 - left)) & 0xFFFFFFFF
    return [(word + other) & 0xFFFFFFFF for word, other in zip(x, start)]


@lru_cache(maxsize=None)
def draws(sizes: tuple[int, ...], count: int = RESAMPLES) -> list[list[list[int]]]:
    """Which runs each resample takes: `[resample][task][run]`."""
    key, buffer, counter = _key(0), [], 0
    resamples = []
    for _ in range(count):
        resample = []
        for size in sizes:
            while len(buffer) < 2 * size:
                buffer += _block(key, counter)
                counter += 1
            pairs, buffer = buffer[: 2 * size], buffer[2 * size :]
            resample.append([((high << 32 | low) * size) >> 64 for low, high in zip(pairs[::2], pairs[1::2])])
        resamples.append(resample)
    return resamples


def percentile(distribution: Sequence[float]) -> Bounds:
    ordered, tail = sorted(distribution), (1 - CONFIDENCE) / 2
    return quantile(ordered, tail), quantile(ordered, 1 - tail)


def bootstrap(scores: list[list[float]], statistic: Callable[[list[list[float]]], float]) -> Bounds:
    """The percentile interval; the runs of each task are resampled by themselves."""
    if min(map(len, scores)) < 2:
        return None

    def of(resample: list[list[int]]) -> float:
        return statistic([[task[i] for i in taken] for task, taken in zip(scores, resample)])

    return percentile([of(resample) for resample in draws(tuple(map(len, scores)))])


def bootstrap_whole(scores: list[list[float]], statistic: Callable[[list[list[float]]], float]) -> Bounds:
    """The percentile interval; a seed that is drawn brings its scores on all tasks."""
    if len(scores[0]) < 2:
        return None

    def of(taken: list[int]) -> float:
        return statistic([[task[i] for i in taken] for task in scores])

    return percentile([of(taken) for [taken] in draws((len(scores[0]),))])


def ratio_of_means(pairs: Sequence[tuple[float, float]]) -> tuple[float, Bounds]:
    """The mean numerator over the mean denominator, with the interval that docs/metrics.md gives so many pairs."""

    def ratio(pairs: Sequence[tuple[float, float]]) -> float:
        return sum(a for a, _ in pairs) / sum(b for _, b in pairs)

    bounds = fieller(pairs)
    if len(pairs) < FEW or bounds is None:
        return ratio(pairs), bounds
    return ratio(pairs), percentile([ratio([pairs[i] for i in taken]) for [taken] in draws((len(pairs),))])


def fieller(pairs: Sequence[tuple[float, float]]) -> Bounds:
    """Fieller's (1954) interval of the mean x over the mean y: the roots of t(r) = ±t, of Student's t of the mean of
    d(r) = x - r y. None where it has no end, as where the mean of y is not told from 0."""
    size = len(pairs)
    if size < 2:
        return None
    above, below = [x for x, _ in pairs], [y for _, y in pairs]
    x, y = mean(above), mean(below)

    def product(one: Sequence[float], other: Sequence[float]) -> float:
        middle, middle_other = mean(one), mean(other)
        return sum((a - middle) * (b - middle_other) for a, b in zip(one, other)) / (size - 1) / size

    t = t_quantile((1 + CONFIDENCE) / 2, size - 1) ** 2
    a, b, c = y * y - t * product(below, below), x * y - t * product(above, below), x * x - t * product(above, above)
    if a <= 0:
        return None
    root = math.sqrt(max(b * b - a * c, 0.0))
    return (b - root) / a, (b + root) / a


def median_interval(values: Sequence[float]) -> Bounds:
    """The exact interval of a median: from the k-th lowest to the k-th highest, k as large as P(B < k) is at most 2.5%,
    of a binomial B of n trials of probability 1/2. None where not even k = 1 is so."""
    n, below, k = len(values), 0, 0
    while k < n and (below + math.comb(n, k)) / 2**n <= (1 - CONFIDENCE) / 2:
        below += math.comb(n, k)
        k += 1
    ordered = sorted(values)
    return (ordered[k - 1], ordered[-k]) if k else None


def t_interval(values: Sequence[float]) -> Bounds:
    """Student's interval of the mean."""
    if len(values) < 2:
        return None
    half = t_quantile((1 + CONFIDENCE) / 2, len(values) - 1) * deviation(values, without=1) / math.sqrt(len(values))
    return mean(values) - half, mean(values) + half


def mean_interval(values: Sequence[float]) -> Bounds:
    """The interval of a mean that docs/metrics.md gives so many values."""
    if len(values) < 2:
        return None
    middle, spread, root = mean(values), deviation(values, without=1), math.sqrt(len(values))
    student = t_quantile((1 + CONFIDENCE) / 2, len(values) - 1) * spread / root
    if len(values) < LEAST_STUDENTISED:
        return middle - student, middle + student
    if len(values) >= FEW:
        return percentile([mean([values[i] for i in taken]) for [taken] in draws((len(values),))])
    if spread == 0:
        return middle, middle
    away = []
    for [taken] in draws((len(values),)):
        resample = [values[i] for i in taken]
        constant = all(value == resample[0] for value in resample)
        other = resample[0] if constant else mean(resample)
        error = 0.0 if constant else deviation(resample, without=1) / root
        if other == middle:
            away.append(0.0)
        else:
            away.append((other - middle) / error if error else math.copysign(math.inf, other - middle))
    away.sort()
    tail = (1 - CONFIDENCE) / 2
    low, high = (middle - quantile(away, share) * spread / root for share in (1 - tail, tail))
    return max(low, middle - FARTHEST * student), min(high, middle + FARTHEST * student)


def share_interval(count: float, n: int) -> Bounds:
    """Clopper and Pearson's interval of a count, which ties may put between two whole ones."""
    if n < 2:
        return None
    whole = round(count)
    below, above = (whole, whole) if abs(count - whole) < 1e-9 else (math.floor(count), math.ceil(count))
    return 1 - _largest(n - below, n), _largest(above, n)


def _largest(count: int, n: int) -> float:
    """The largest probability with which at most `count` of `n` has a chance of the tail's."""
    if count == n:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(60):
        p = (low + high) / 2
        terms = (math.log(math.comb(n, k)) + k * math.log(p) + (n - k) * math.log1p(-p) for k in range(count + 1))
        chance = math.fsum(map(math.exp, terms))
        low, high = (p, high) if chance >= (1 - CONFIDENCE) / 2 else (low, p)
    return low


def p_value(differences: Sequence[float]) -> float | None:
    """The two-sided p-value of Student's test; none where all are the same."""
    if len(differences) < 2 or all(value == differences[0] for value in differences):
        return None
    t = abs(mean(differences)) / (deviation(differences, without=1) / math.sqrt(len(differences)))
    return _t_outside(t, len(differences) - 1)


def holm(p_values: dict[str, float]) -> dict[str, float]:
    """Holm's step-down."""
    adjusted, largest = {}, 0.0
    for rank, (name, p) in enumerate(sorted(p_values.items(), key=lambda item: item[1])):
        largest = min(max(largest, (len(p_values) - rank) * p), 1.0)
        adjusted[name] = largest
    return adjusted


@lru_cache(maxsize=None)
def t_quantile(probability: float, degrees: int) -> float:
    low, high = 0.0, 1e6
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if 1 - _t_outside(middle, degrees) / 2 < probability else (low, middle)
    return high


def _t_outside(t: float, degrees: int) -> float:
    """The probability that Student's t is beyond ±t: the incomplete beta function at ν / (ν + t²)."""
    return _beta(degrees / 2, 0.5, degrees / (degrees + t * t)) if t else 1.0


def _beta(a: float, b: float, x: float) -> float:
    """The regularised incomplete beta function, by Lentz's continued fraction (Numerical Recipes, 6.4)."""
    if x > (a + 1) / (a + b + 2):
        return 1 - _beta(b, a, 1 - x) if x < 1 else 1.0
    log = a * math.log(x) + b * math.log1p(-x) + math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    c, d = 1.0, 1 / (1 - (a + b) * x / (a + 1))
    fraction = d
    for m in range(1, 1000):
        for factor in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d, c = 1 / (1 + factor * d), 1 + factor / c
            fraction *= c * d
        if abs(c * d - 1) < 1e-16:
            break
    return math.exp(log) * fraction / a
