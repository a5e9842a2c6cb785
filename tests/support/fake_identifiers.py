"""Identifications for tests of `benchmarks.rivals`: functions that a process of its own calls."""

import os
import time

import numpy as np
from benchmarks.rivals.identifiers import Estimate


def missing(log):
    raise ModuleNotFoundError("No module named 'rival'")


def raising(log):
    raise ValueError("it wants\nanother log")


def crashing(log):
    os._exit(1)


def never_ending(log):
    time.sleep(60)


def not_finite(log):
    return Estimate(np.full(3, np.nan), None, np.zeros((4, 2)))


def right(log):
    return Estimate(np.zeros(3), np.eye(3), np.zeros((4, 2)))
