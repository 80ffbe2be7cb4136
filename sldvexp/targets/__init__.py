"""Calibration objects: what stands in front of the instrument at positions known beforehand."""
