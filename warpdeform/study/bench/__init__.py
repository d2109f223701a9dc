"""Benchmarks: what the kernels, a step and a start cost, measured against a yardstick in the same run.

Each benchmark is declared as data and has one runner; `warpdeform bench` prints the tables of docs/performance.md.
"""
