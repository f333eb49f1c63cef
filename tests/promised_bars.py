"""Shares of rows that docs/accuracy.md promises to lie inside their error bars.

They hold for scenes from which no number of the rule of error bars was chosen.
"""

ALL_ROWS = 0.97  # of the forces of all classes of scenes together lie inside their bars
ROWS_OF_A_CLASS = 0.93  # of one class
FEWEST_ROWS = 15  # of a class that can be judged so: of fewer a single row is more than 7 %
BAR_OVER_ERROR = 6.0  # in the median of all rows of all classes, at most: wider bars say little
WIDEST, SMALL_ERROR = (
    0.2,
    0.01,
)  # no bar is wider, relative to its force, where the error is smaller
