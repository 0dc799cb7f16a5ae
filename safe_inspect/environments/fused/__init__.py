"""The fused step: one compiled kernel calls the row terms of a group of agents one after the other.

A sensor, reward or done function that is defined by a row kernel is called by the address of its loop. Every other
plugin is called in Python as usual, and its result is passed to the kernel. The numbers are bit-identical in both
cases.
"""
