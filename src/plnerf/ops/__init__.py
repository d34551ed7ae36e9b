"""Numerical kernels: a reference of each op in plain torch, and faster kernels that agree with it."""
