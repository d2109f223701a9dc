"""Peers: other engines on the sheet of `hanging`, on one core, each against a converged reference of its own law.

One file per engine, one for the sheet, one for the laws that only single-precision solvers have, one for processes and
references, one for errors; `warpdeform bench peers` prints the tables of docs/performance.md. None of the peers is
needed: what cannot be imported is reported as missing.
"""
