"""What the commands import, so that a process forked afterwards need not: no thread is started by it."""

# ruff: noqa: F401
import imageio
import scipy.signal
import scipy.stats
import tests.support.tiny_run
import torch.utils.tensorboard
import torchmetrics.image

import plnerf.cli.main
import plnerf.console
import plnerf.pipeline
