"""One new run compared with a history of runs: the prediction interval.

A history holds one value of a metric per earlier run, all of one plan on one kind of machine (the
same plan hash, the same host fingerprint). With the logarithms h_1 .. h_m of the last m of them,
their mean h and standard deviation s, and y that of the new run, if nothing has changed

    (y - h) / (s sqrt(1 + 1/m))

follows Student's t with m - 1 degrees of freedom: the new run scatters like the others, and the
mean of the others is uncertain too. If the new run differs by a true ratio rho, y - h - ln rho
does, so that one-sided bounds on rho are

    exp(y - h -+ t_c(m - 1) s sqrt(1 + 1/m)).

That is true of runs that scatter about one level. A machine that gets slower from run to run, or
whose level wanders, makes the new run differ from the mean of the others by more than they scatter,
and yet by no more than one run differs from the run before. With the root mean square s_d of the
m - 1 steps between successive runs,

    exp(y - h_m -+ t_c(m - 1) s_d)

are bounds that such a machine does not break, and the wider of both is used on either side. The
price, where runs scatter about one level: s_d is about sqrt(2) s.

Here s is the variation between runs, not iterations, so that the error is as stated, unlike that
of Welch's test on two runs. More iterations per run make s smaller, but not below the variation
between runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from r2bspec.judge.statistics.paired_ratio import RatioInterval
from r2bspec.judge.statistics.t_interval import mean_interval

MIN_HISTORY_RUNS: Final = 5
"""A history of fewer runs decides nothing: t_0.95(3) / t_0.95(30) is 1.4, t_0.95(1) is 6.3."""

MAX_HISTORY_RUNS: Final = 30
"""Of a longer history, the latest are used: machines and code change slowly."""


def predicted_ratio(history: Sequence[float], new: float, confidence: float) -> RatioInterval:
    """The ratio of a new run to a history with its one-sided bounds.

    Args:
        history: one positive value for each earlier run, oldest first, at least two.
        new: that of the new run, positive.
        confidence: of each bound by itself.

    Raises:
        ValueError: fewer than two earlier runs, or a value that is not positive.
    """
    used = history[-MAX_HISTORY_RUNS:]
    if any(value <= 0 or math.isinf(value) for value in (*used, new)):
        raise ValueError("a ratio needs positive, finite values")
    from scipy.special import stdtrit

    m = len(used)
    logs = [math.log(value) for value in used]
    found = mean_interval(logs, confidence)
    t = float(stdtrit(m - 1, confidence))
    half = t * found.deviation * math.sqrt(1 + 1 / m)
    difference = math.log(new) - found.mean
    step = t * math.sqrt(math.fsum((b - a) ** 2 for a, b in pairwise(logs)) / (m - 1))
    last = math.log(new) - logs[-1]
    return RatioInterval(
        ratio=math.exp(difference),
        lower=math.exp(min(difference - half, last - step)),
        upper=math.exp(max(difference + half, last + step)),
        deviation=found.deviation,
        n=m,
    )
