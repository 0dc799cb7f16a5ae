"""The fused step: the terms of a group of agents as a table that one compiled kernel works through.

`translate` makes the `Table` of a group: every plugin that has a translator (`translators`) becomes a few numbers, and
every other one is called as ever, its result handed to the kernel. The numbers are the same to the bit either way.
"""
