"""What the paper's words are read as, where it gives no number: one reading for each word."""

ALIKE_PERCENT = 2.0  # unchanged, the same, does not affect; and a tie
MARGINAL_PERCENT = 2.0  # marginal; more is substantial
ROBUST_PERCENT = 5.0  # robust
ROUGHLY_PERCENT = 10.0  # in proportion, roughly the same
ABOUT_POINTS = 5.0  # percentage points: approximately 75 %, 50 %, 30 %
ALL_PERCENT = 99.9  # of the data: all of it

READINGS = (
    f'better, more, less: the interval is on one side of zero; '
    f'a tie: it holds zero, and no more than {ALIKE_PERCENT:g} % either way',
    f'unchanged, the same, does not affect: within {ALIKE_PERCENT:g} %',
    f'in proportion, roughly the same: within {ROUGHLY_PERCENT:g} %',
    f'about so many per cent: within {ABOUT_POINTS:g} percentage points',
    f'marginal: no more than {MARGINAL_PERCENT:g} %; substantial: more',
    f'robust: no more than {ROBUST_PERCENT:g} % lost',
    f'all data: {ALL_PERCENT:g} % or more',
)
