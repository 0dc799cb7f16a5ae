"""The fused step: the row terms of a group of agents, called one after the other by one compiled kernel.

A sensor, reward or done function that a row kernel defines is called by the address of its loop; every other plugin is
called as ever, its result handed to the kernel. The numbers are the same to the bit either way.
"""
