"""Measured curves: readers of text tables and AFM files, writer of .tab files."""
