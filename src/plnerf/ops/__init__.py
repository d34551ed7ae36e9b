"""The numerical kernels: a plain torch truth, and faster twins that agree with it."""
