"""Counter-based random numbers: functions of seed, slot, episode and purpose."""
