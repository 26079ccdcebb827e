"""Tables of numbers in text files: find the table below any preamble, and read it.

Instruments and programs write lines of facts before the table, beside it and below it. The rows of
numbers decide where the table is: the last lines that look alike, and what fits them above.
"""
