"""Slices become columns that hold exactly what the slices hold."""

from __future__ import annotations

import numpy as np

from inkloop.geometry import cell_centers
from inkloop.geometry.layer_runs import columns_of_layers

NX, NY, PITCH, THICKNESS = 5, 4, 1e-4, 7.6e-6


def test_every_height_has_the_label_of_its_slice() -> None:
    layers = np.random.default_rng(3).integers(0, 3, (9, NX, NY)).astype(np.int8)
    whole, *by_label = columns_of_layers(layers, NX, NY, PITCH, THICKNESS, labels=2)
    x, y = cell_centers(NX, NY, PITCH)
    for number, layer in enumerate(layers):
        for share in (1e-9, 0.5, 1.0 - 1e-9):
            z = np.full((NX, NY), (number + share) * THICKNESS)
            np.testing.assert_array_equal(whole.contains(x, y, z), layer > 0)
            for label, columns in enumerate(by_label, start=1):
                np.testing.assert_array_equal(columns.contains(x, y, z), layer == label)


def test_slices_that_follow_each_other_are_one_interval_and_share_no_point_with_the_next() -> None:
    layers = np.array([[[1]], [[1]], [[2]], [[0]], [[1]]], np.int8)
    whole, first, second = columns_of_layers(layers, 1, 1, PITCH, THICKNESS, labels=2)
    np.testing.assert_array_equal(whole.bottoms, np.array([0, 4]) * THICKNESS)
    np.testing.assert_array_equal(whole.tops, np.array([3, 5]) * THICKNESS)
    assert first.tops[0] == second.bottoms[0]


def test_no_slice_is_nothing() -> None:
    (whole,) = columns_of_layers([], NX, NY, PITCH, THICKNESS, labels=0)
    assert not whole.mask.any()
