"""Noise: its distribution and its seed."""

from __future__ import annotations

import numpy as np

from desat.components.maths import noise


def test_noise_is_normal_and_seeded():
    draws = np.array([noise.normal3(7, i) for i in range(20000)])
    assert np.abs(draws.mean(axis=0)).max() < 0.03
    assert np.abs(draws.std(axis=0) - 1).max() < 0.03
    assert np.abs(np.corrcoef(draws.T) - np.eye(3)).max() < 0.03
    assert abs(np.corrcoef(draws[1:, 0], draws[:-1, 0])[0, 1]) < 0.03
    assert noise.normal3(7, 5) == noise.normal3(7, 5)
    assert noise.normal3(7, 5) != noise.normal3(8, 5)
    assert 0 < min(noise.uniform(1, i) for i in range(20000)) < 1e-3
