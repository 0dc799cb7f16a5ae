"""Sensor logs: what camera and inertial unit have measured, on disk, without the simulator."""
